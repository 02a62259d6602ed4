"""Parked vehicles as instances: every wheel on the ground, engine and lamps off, nobody in the saddle."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pavetwin.scene.agents import ParkedInstances, Wheels
from pavetwin.scene.meshes import bounds
from pavetwin.scene.models import library
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import Instance, labelled_agent, labelled_defect, labelled_place, parked_label
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.parked import PARKING_CLASSES, RIDERLESS_HEIGHT_M, ParkedVehicles
from scenes.parking import full_street

KERB_M = 0.12
PARKING = [kind.name for kind in KINDS.values() if kind.sumo_class in PARKING_CLASSES]

Ground = Callable[[np.ndarray], np.ndarray]


def stands(kind: str, *, x: float = 3.0, y: float = -1.0, yaw_rad: float = 0.0, place: int = 0) -> ParkedVehicles:
    size = KINDS[kind]
    height = RIDERLESS_HEIGHT_M.get(kind, size.height_m)
    values = (np.array([value]) for value in (x, y, yaw_rad, size.length_m, size.width_m, height, 77 + place))
    return ParkedVehicles(np.array([place]), (kind,), *values)


def instances(parked: ParkedVehicles, ground: Ground, seed: int = 0) -> tuple[Instance, ...]:
    return ParkedInstances(seed=seed, models=library(), ground=ground).of(parked)


def flat(xy: np.ndarray) -> np.ndarray:
    return np.zeros(len(xy))


def kerb(xy: np.ndarray) -> np.ndarray:
    """The road lies in the south, the kerb along y = −1."""
    return np.where(xy[:, 1] > -1.0, KERB_M, 0.0)


def tyres(instance: Instance) -> np.ndarray:
    """(4, 3) where the tyres touch: front left, front right, rear left, rear right."""
    points = Wheels.of(library()[instance.model]).points
    local = np.column_stack([points, np.zeros(4), np.ones(4)])
    return (local @ instance.transform.T)[:, :3]


def points_of(instance: Instance) -> np.ndarray:
    """(n, 3) vertices, world frame."""
    points = library()[instance.model].parts[instance.part].positions.astype(float)
    return points @ instance.transform[:3, :3].T + instance.transform[:3, 3]


@pytest.mark.parametrize("kind", PARKING)
def test_a_vehicle_stands_on_the_road_in_its_own_size(kind: str) -> None:
    parked = stands(kind, yaw_rad=math.pi / 2)
    points = points_of(instances(parked, flat)[0])
    low, high = points.min(axis=0), points.max(axis=0)
    lean_m = 0.02 if kind in RIDERLESS_HEIGHT_M else 0.005
    assert low[2] == pytest.approx(0.0, abs=lean_m)
    assert high[2] == pytest.approx(parked.height_m[0], abs=lean_m)
    assert (low[1] + high[1]) / 2 == pytest.approx(-1.0, abs=0.01)
    assert high[1] - low[1] == pytest.approx(parked.length_m[0], abs=0.02)


@pytest.mark.parametrize("kind", [kind for kind in PARKING if kind not in RIDERLESS_HEIGHT_M])
@pytest.mark.parametrize("yaw_rad", [0.0, math.pi, math.pi / 2, 1.0])
def test_half_on_the_kerb_every_wheel_touches(kind: str, yaw_rad: float) -> None:
    """Along the kerb the vehicle rolls, across it it pitches; askew it may rest on three wheels and its springs."""
    (instance,) = instances(stands(kind, yaw_rad=yaw_rad), kerb)
    touching = tyres(instance)
    askew_m = KERB_M / 2 if yaw_rad == 1.0 else 0.002
    assert touching[:, 2] == pytest.approx(kerb(touching[:, :2]), abs=askew_m)
    assert set(kerb(touching[:, :2])) == {0.0, KERB_M}
    up = instance.transform[:3, 2]
    assert up[1] < -0.02, "it leans towards the road"
    drawn_as = KINDS[KINDS[kind].model or kind]
    assert np.linalg.norm(up) == pytest.approx(KINDS[kind].height_m / drawn_as.height_m)


def test_on_the_kerb_it_stands_level_and_higher() -> None:
    (instance,) = instances(stands("van", y=3.0), kerb)
    assert tyres(instance)[:, 2] == pytest.approx(np.full(4, KERB_M))
    assert instance.transform[:3, 2] == pytest.approx([0, 0, 1])


def test_a_parked_motorcycle_leans_to_its_left_without_a_rider() -> None:
    (parked,), ridden = instances(stands("motorcycle", yaw_rad=0.0), flat), library()["motorcycle"]
    assert parked.model == "motorcycle_parked"
    up = parked.transform[:3, 2]
    assert math.degrees(math.atan2(up[1], up[2])) == pytest.approx(10.0)
    machine, whole = library()[parked.model].parts["body"], ridden.parts["body"]
    assert len(machine.positions) < 0.75 * len(whole.positions)
    assert bounds(whole)[1][2] - bounds(machine)[1][2] > 0.2, "the helmet is gone"
    points = points_of(parked)
    foot = points[points[:, 1] > -1.0 + 0.22]
    assert foot[:, 2].min() == pytest.approx(0.0, abs=0.01), "its side stand touches"


def test_engines_and_lamps_are_off() -> None:
    for kind in PARKING:
        (instance,) = instances(stands(kind), flat)
        assert (instance.tints[:, 3] == 0).all()


def test_colours_follow_from_the_seed_and_the_draw_alone() -> None:
    cars = full_street().environment(full_street().settings("parking.occupancy=1")).parked
    scene = Scene(full_street().world, seed=3)
    tints = [instance.tints for instance in scene.parked(cars)]
    again = [instance.tints for instance in Scene(full_street().world, seed=3).parked(cars.only(np.arange(5, 10)))]
    assert all((one == other).all() for one, other in zip(tints[5:10], again, strict=True))
    assert len({tint.tobytes() for tint in tints}) > 12
    other_draw = replace(cars, appearance=cars.appearance + 1)
    assert any((a.tints != b).any() for a, b in zip(scene.parked(other_draw), tints, strict=True))
    assert any((a.tints != b).any() for a, b in zip(Scene(scene.world, seed=4).parked(cars), tints, strict=True))


def test_only_what_reaches_into_the_disc_is_drawn() -> None:
    scene = full_street()
    cars = scene.environment(scene.settings("parking.occupancy=1")).parked
    drawn = Scene(scene.world, seed=0).parked(cars, near=(3.0, 4.8, 6.2))
    assert [labelled_place(each.label) for each in drawn] == [0, 2]
    assert len(Scene(scene.world, seed=0).parked(cars)) == len(cars) == 20


def test_a_label_is_of_an_agent_a_parked_vehicle_or_a_defect() -> None:
    label = parked_label(5)
    assert (labelled_agent(label), labelled_place(label), labelled_defect(label)) == (None, 5, None)
    with pytest.raises(ValueError, match="no label"):
        parked_label(1 << 22)
