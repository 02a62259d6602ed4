"""The models of trees and street furniture: what they say of themselves is so, and lamps and plates look ahead."""

import numpy as np
import pytest
from assets.models.materials import MATERIALS

from model_files import FOLDER, Surface, points, read_model
from pavetwin.scene.foliage import CUT, SIDE_PX, leaf_atlas
from pavetwin.scene.models import library

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
    """Seen straight from above, on spots of the crown's disc: whatever cards hold over it, cut as the sheet says."""
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
def test_things_beside_the_road_stand_on_the_ground(name: str) -> None:
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
def test_a_sign_shows_its_colours_to_who_comes_towards_it(name: str) -> None:
    node = the_node(name)
    for material in ("sign_red", "sign_white"):
        assert node[material].normals[:, 0].min() > 0.99
    assert node["mast"].normals[:, 0].min() < -0.99


def test_a_street_light_shines_down() -> None:
    node = the_node("lamp_head")
    assert node["lens"].positions[:, 2].max() <= min(0.0, float(points(node)[:, 2].mean()))
