"""The models of people: sizes of their kinds, feet on the ground, a gait that neither limps nor slides."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from model_files import FOLDER, points, read_model
from pavetwin.traffic.kinds import KINDS, PEDESTRIANS

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
