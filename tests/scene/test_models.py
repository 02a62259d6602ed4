"""The committed models of vehicles, people and the street: real sizes, known materials, valid meshes, budgets."""

from collections.abc import Iterator

import numpy as np
import pytest
from assets.models.materials import MATERIALS
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from model_files import FOLDER, Surface, points, read_model
from pavetwin.scene.foliage import CUT, SIDE_PX, leaf_atlas
from pavetwin.scene.glb import Glb, from_file_axes, read_glb
from pavetwin.scene.models import library
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS, VEHICLES

ALL = sorted(path.stem for path in FOLDER.glob("*.glb"))
ROAD = [kind.name for kind in VEHICLES]
TRIANGLES = {"bus": 12_000, "heavy_truck": 12_000, "quadrotor": 9_000}
"""Most triangles of a model where it is not 9,000."""


def primitives(glb: Glb) -> Iterator[tuple[str, dict[str, NDArray[np.float64]], NDArray[np.int64]]]:
    """Material, attributes and triangles (m, 3) of each primitive."""
    materials = [material["name"] for material in glb.document["materials"]]
    for mesh in glb.document["meshes"]:
        for one in mesh["primitives"]:
            attributes = {name: glb.array(index) for name, index in one["attributes"].items()}
            yield materials[one["material"]], attributes, glb.array(one["indices"]).reshape(-1, 3)


def places(glb: Glb, *materials: str) -> NDArray[np.float64]:
    """Vertices (n, 3) in our axes, of some materials or of all."""
    found = [from_file_axes(a["POSITION"]) for name, a, _ in primitives(glb) if not materials or name in materials]
    return np.concatenate(found).astype(np.float64)


def test_every_kind_of_vehicle_and_the_uav_have_a_model() -> None:
    assert {*ROAD, "quadrotor"} <= set(ALL)


@pytest.mark.parametrize("name", ROAD)
def test_vehicle_stands_on_its_wheels_and_looks_ahead(name: str) -> None:
    glb = read_glb(FOLDER / f"{name}.glb")
    assert places(glb)[:, 2].min() == pytest.approx(0.0, abs=0.005)
    assert places(glb, "tyre")[:, 2].min() == pytest.approx(0.0, abs=0.005)
    assert places(glb, "lamp_front")[:, 0].min() > 0.2 * KINDS[name].length_m
    assert places(glb, "lamp_rear")[:, 0].max() < -0.2 * KINDS[name].length_m


def test_uav_is_as_big_as_a_phantom_4() -> None:
    glb = read_glb(FOLDER / "quadrotor.glb")
    points = places(glb)
    body = points[points[:, 2] < 0.175]  # below the propellers
    assert np.ptp(body[:, 0]) == pytest.approx(0.29, abs=0.01)
    assert np.ptp(body[:, 1]) == pytest.approx(0.29, abs=0.01)
    assert points[:, 2].min() == pytest.approx(0.0, abs=0.002)
    assert points[:, 2].max() == pytest.approx(0.196, abs=0.005)
    assert places(glb, "glass")[:, 2].max() < 0.05  # the lens looks down


@pytest.mark.parametrize("name", ALL)
def test_model_is_a_sound_mesh_of_known_materials(name: str) -> None:
    for material, attributes, corners in primitives(read_glb(FOLDER / f"{name}.glb")):
        assert material in MATERIALS
        assert set(attributes) >= {"POSITION", "NORMAL", "COLOR_0"}
        assert ("TEXCOORD_0" in attributes) == (name.startswith("tree_") and material == "leaf")
        assert corners.max() < len(attributes["POSITION"]) <= 65_535
        assert np.linalg.norm(attributes["NORMAL"], axis=1) == pytest.approx(1.0, abs=1e-3)
        assert attributes["COLOR_0"].min() >= 0.0
        assert attributes["COLOR_0"].max() <= 1.0


@pytest.mark.parametrize("name", [*ROAD, "quadrotor"])
def test_triangles_are_within_the_budget(name: str) -> None:
    triangles = sum(len(corners) for _, _, corners in primitives(read_glb(FOLDER / f"{name}.glb")))
    assert triangles <= TRIANGLES.get(name, 9_000)


@pytest.mark.parametrize("name", [*ROAD, "quadrotor"])
def test_faces_look_the_way_their_normals_do(name: str) -> None:
    for material, attributes, corners in primitives(read_glb(FOLDER / f"{name}.glb")):
        points, normals = attributes["POSITION"].astype(float)[corners], attributes["NORMAL"].astype(float)[corners]
        faces = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
        agree = (faces * normals.sum(axis=1)).sum(axis=1) > 0.0
        area = np.linalg.norm(faces, axis=1)
        assert area[agree].sum() > 0.99 * area.sum(), material


@pytest.mark.parametrize("name", ROAD)
def test_the_top_is_open_and_what_looks_down_is_dark(name: str) -> None:
    top, below = [], []
    for _, attributes, _ in primitives(read_glb(FOLDER / f"{name}.glb")):
        z, up = attributes["POSITION"][:, 1], attributes["NORMAL"][:, 1]
        shade = attributes["COLOR_0"][:, :3].max(axis=1)
        top.append(shade[(up > 0.9) & (z > 0.8 * KINDS[name].height_m)])
        below.append(shade[up < -0.3])
    assert np.percentile(np.concatenate(top), 75) > 0.85
    assert np.concatenate(below).mean() < 0.75


@pytest.mark.parametrize("name", [kind.name for kind in VEHICLES if kind.sumo_class == "passenger"])
def test_no_black_lines_are_seen_from_above(name: str) -> None:
    """Thinner than a pixel they would be drawn as dashes: gaps between panels are darker paint."""
    for material, attributes, _ in primitives(read_glb(FOLDER / f"{name}.glb")):
        if material == "gap":
            z, up = attributes["POSITION"][:, 1], attributes["NORMAL"][:, 1]
            assert not ((up > 0.5) & (z > 0.55 * KINDS[name].height_m)).any()


def test_models_are_small_together() -> None:
    sizes = {path.stem: path.stat().st_size for path in FOLDER.glob("*.glb")}
    assert sum(sizes.values()) <= 10 * 2**20
    assert sum(sizes[name] for name in [*ROAD, "quadrotor"]) <= 5 * 2**20


NAMES = sorted(path.stem for path in FOLDER.glob("pedestrian_*.glb"))
STEPS = [f"walk_{k}" for k in range(8)]
CARRIED = frozenset({"bag", "wood"})
people = pytest.mark.parametrize("name", NAMES)


def left_shoe(name: str, step: str) -> np.ndarray:
    """Vertices of the left shoe: the first half of the shoes, as left limbs come first."""
    shoes = read_model(name).nodes[step]["shoes"].positions
    return shoes[: len(shoes) // 2]


def test_every_kind_of_person_has_a_model_and_there_are_at_least_six() -> None:
    assert len(NAMES) >= 6
    assert {read_model(name).extras["kind"] for name in NAMES} == {kind.name for kind in PEDESTRIANS}


@people
def test_a_person_has_eight_steps_and_a_rest_within_the_budget(name: str) -> None:
    model = read_model(name)
    assert set(model.nodes) == {*STEPS, "stand"}
    assert all(model.triangles(node) <= 2600 for node in model.nodes)
    assert (FOLDER / f"{name}.glb").stat().st_size < 400_000


@people
def test_the_colours_of_clothes_are_left_to_the_scene(name: str) -> None:
    for surfaces in read_model(name).nodes.values():
        assert {"top", "bottom", "hair", "skin", "shoes"} <= set(surfaces)


@people
def test_at_rest_a_body_has_the_size_of_its_kind(name: str) -> None:
    model = read_model(name)
    kind = KINDS[str(model.extras["kind"])]
    body = points(model.nodes["stand"], without=CARRIED)
    size = np.ptp(body, axis=0)
    # Neither a pony tail nor the peak of a cap makes a body deeper.
    body = points(model.nodes["stand"], without=CARRIED | {"hair", "hat"})
    size[0] = np.ptp(body[:, 0])
    if "wood" in model.nodes["stand"]:  # the right arm leaves the body's side to hold the stick
        size[0] = np.ptp(body[body[:, 1] > -0.14, 0])
        size[1] = 2.0 * body[:, 1].max()
    assert size == pytest.approx((kind.length_m, kind.width_m, kind.height_m), abs=0.01)


@people
def test_soles_touch_the_ground_in_every_pose_and_nothing_is_below(name: str) -> None:
    for surfaces in read_model(name).nodes.values():
        assert surfaces["shoes"].positions[:, 2].min() == pytest.approx(0.0, abs=0.002)
        assert points(surfaces)[:, 2].min() > -0.02


@people
def test_a_swinging_foot_is_lifted_and_comes_forward(name: str) -> None:
    lifted = left_shoe(name, "walk_6")
    assert lifted[:, 2].min() > 0.004
    assert lifted[:, 0].mean() > left_shoe(name, "walk_5")[:, 0].mean() + 0.1


@people
@pytest.mark.parametrize("step", range(4))
def test_half_a_cycle_later_left_is_right(name: str, step: int) -> None:
    model = read_model(name)
    now, later = model.nodes[f"walk_{step}"], model.nodes[f"walk_{step + 4}"]
    carries = bool(CARRIED & set(now))
    for material in ("bottom", "shoes") if carries else set(now):
        mirrored = now[material].positions * (1.0, -1.0, 1.0)
        distances, _ = cKDTree(mirrored).query(later[material].positions)
        assert distances.max() < 0.002, material


@people
def test_surfaces_look_outwards(name: str) -> None:
    """Faces agree with their normals, and the shoes enclose a volume."""
    surfaces = read_model(name).nodes["walk_1"]
    for surface in surfaces.values():
        a, b, c = (surface.positions[surface.triangles[:, i]] for i in range(3))
        face = np.cross(b - a, c - a)
        mean = surface.normals[surface.triangles].mean(axis=1)
        assert (np.einsum("ij,ij->i", face, mean) > 0).mean() > 0.95
    shoes = surfaces["shoes"]
    a, b, c = (shoes.positions[shoes.triangles[:, i]].astype(float) for i in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 > 1e-4


TREES = sorted(path.stem for path in FOLDER.glob("tree_*.glb"))
SIGNS = ("sign_round", "sign_triangle", "sign_octagon")
HEADS = ("lamp_head", "signal_head", "signal_pedestrian", *SIGNS)
BESIDE = ("bench", "bin", "bollard", "hydrant", "bicycle_stand", "bicycle", "hedge")
SIZES_M = {
    "bench": (0.60, 1.80, 0.88),
    "bin": (0.46, 0.46, 0.95),
    "bollard": (0.17, 0.17, 1.00),
    "hydrant": (0.35, 0.40, 0.80),
    "bicycle_stand": (0.87, 0.12, 0.80),
    "bicycle": (1.75, 0.62, 1.02),
    "hedge": (1.0, 0.6, 0.95),
    "sign_round": (0.03, 0.60, 0.60),
    "sign_triangle": (0.03, 0.90, 0.78),
    "sign_octagon": (0.03, 0.75, 0.75),
    "lamp_head": (0.62, 0.28, 0.09),
    "signal_head": (0.44, 0.35, 1.08),
    "signal_pedestrian": (0.35, 0.25, 0.53),
}


def the_node(name: str) -> dict[str, Surface]:
    model = read_model(name)
    (node,) = model.nodes.values()
    return node


@pytest.mark.parametrize("name", TREES)
def test_a_tree_is_a_trunk_on_the_ground_and_a_crown_of_the_stated_size(name: str) -> None:
    model = read_model(name)
    assert list(model.nodes) == ["trunk", "crown"]
    trunk, crown = points(model.nodes["trunk"]), points(model.nodes["crown"])
    assert trunk[:, 2].min() == pytest.approx(0.0, abs=0.01)
    assert crown[:, 2].min() == pytest.approx(model.extras["clear_height_m"], abs=0.01)
    assert max(crown[:, 2].max(), trunk[:, 2].max()) == pytest.approx(model.extras["height_m"], abs=0.01)
    radii = np.linalg.norm(crown[:, :2], axis=1)
    assert np.quantile(radii, 0.995) == pytest.approx(model.extras["crown_radius_m"], rel=0.05)
    assert np.linalg.norm(trunk[:, :2], axis=1).max() < model.extras["crown_radius_m"]
    assert model.triangles("trunk") + model.triangles("crown") < 6000


@pytest.mark.parametrize("name", TREES)
def test_a_crown_hides_most_of_the_ground_and_lets_some_light_through(name: str) -> None:
    """Seen straight from above, on spots of the crown's disc: whatever cards hold over it, cut by the sheet."""
    crown, radius = library()[name].parts["crown"], 0.9 * library()[name].extras["crown_radius_m"]
    assert crown.uv is not None
    corners, uv = crown.positions[crown.indices][..., :2].astype(float), crown.uv[crown.indices]
    rng = np.random.default_rng(0)
    spots = rng.uniform(-radius, radius, (600, 2))
    spots = spots[np.linalg.norm(spots, axis=1) < radius]
    hidden = np.array([_covered(corners, uv, spot) for spot in spots])
    assert 0.85 < hidden.mean() < 0.99


def _covered(triangles: np.ndarray, uv: np.ndarray, spot: np.ndarray) -> bool:
    """Whether any of the triangles (n, 3, 2), whose corners have uv (n, 3, 2), has a leaf over a spot."""
    sides = np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], axis=-1)
    flat = np.abs(np.linalg.det(sides)) < 1e-9
    sides[flat] = np.eye(2)
    share = np.linalg.solve(sides, (spot - triangles[:, 0])[..., None])[..., 0]
    inside = (share >= 0).all(axis=1) & (share.sum(axis=1) <= 1) & ~flat
    weights = np.column_stack([1 - share.sum(axis=1), share])[inside]
    at = np.einsum("nk,nkc->nc", weights, uv[inside])
    column, row = np.clip((at * SIDE_PX).astype(int), 0, SIDE_PX - 1).T
    return bool((leaf_atlas()[row, column, 3] >= 255 * CUT).any())


@pytest.mark.parametrize("name", TREES)
def test_leaves_are_darker_below_and_differ_in_green(name: str) -> None:
    leaves = read_model(name).nodes["crown"]["leaf"]
    height, value = leaves.positions[:, 2], leaves.colours.mean(axis=1)
    low, high = np.quantile(height, [0.25, 0.75])
    assert value[height < low].mean() < 0.75 * value[height > high].mean()
    bright = leaves.colours[value > 0.3]
    assert np.std(bright[:, 0] / bright[:, 1]) > 0.02


@pytest.mark.parametrize("name", SIZES_M)
def test_things_of_the_street_have_their_real_sizes(name: str) -> None:
    assert np.ptp(points(the_node(name)), axis=0) == pytest.approx(SIZES_M[name], abs=0.06)


@pytest.mark.parametrize("name", BESIDE)
def test_things_next_to_the_road_stand_on_the_ground(name: str) -> None:
    assert points(the_node(name))[:, 2].min() == pytest.approx(0.0, abs=0.012)


@pytest.mark.parametrize("name", [*HEADS, *BESIDE])
def test_things_of_the_street_are_light_and_of_known_materials(name: str) -> None:
    assert set(the_node(name)) <= set(MATERIALS)
    assert read_model(name).triangles(name) <= 1600


@pytest.mark.parametrize(
    ("name", "lamps"),
    [("signal_head", ["lamp_red", "lamp_amber", "lamp_green"]), ("signal_pedestrian", ["lamp_red", "lamp_green"])],
)
def test_signals_look_ahead_red_above_each_under_a_visor(name: str, lamps: list[str]) -> None:
    node = the_node(name)
    heights = [node[lamp].positions[:, 2].mean() for lamp in lamps]
    assert heights == sorted(heights, reverse=True)
    for lamp, height in zip(lamps, heights, strict=True):
        assert node[lamp].normals[:, 0].min() > -0.05
        housing = node["housing"].positions
        above = housing[np.abs(housing[:, 2] - height) < 0.2]
        assert above[:, 0].max() > node[lamp].positions[:, 0].max() + 0.1


@pytest.mark.parametrize("name", SIGNS)
def test_a_sign_shows_its_colours_to_oncoming_traffic(name: str) -> None:
    node = the_node(name)
    for material in ("sign_red", "sign_white"):
        assert node[material].normals[:, 0].min() > 0.99
    assert node["mast"].normals[:, 0].min() < -0.99


def test_a_street_light_shines_down() -> None:
    node = the_node("lamp_head")
    assert node["lens"].positions[:, 2].max() <= min(0.0, float(points(node)[:, 2].mean()))
