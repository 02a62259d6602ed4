"""Agents and parked vehicles as instances: places, sizes, gait, wheels on the ground, lamps."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pavetwin.scene.agents import BRAKE_GLOW, Actors, ParkedInstances, Wheels, quadrotor
from pavetwin.scene.appearance import appearance_of, people, vehicle_model
from pavetwin.scene.meshes import bounds
from pavetwin.scene.models import library
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import Instance, agent_label, labelled_agent, labelled_defect, labelled_place, parked_label
from pavetwin.traffic.kinds import KINDS, VEHICLES
from pavetwin.traffic.parked import PARKING_CLASSES, RIDERLESS_HEIGHT_M, ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of
from scenes.parking import full_street
from scenes.recordings import Pose, recording


def actors(made: Recording, seed: int = 0) -> Actors:
    return Actors(made, seed=seed, models=library(), ground=lambda xy: np.full(len(xy), 0.12))


def corners(instance: Instance) -> np.ndarray:
    """(n, 3) vertices in the world frame."""
    points = library()[instance.model].parts[instance.part].positions.astype(float)
    return points @ instance.transform[:3, :3].T + instance.transform[:3, 3]


def row(agent: int, _: float) -> Pose:
    return (14.0 * agent, 0.0, 0.0, 0.0)


def test_models_of_people_are_found_by_what_they_show() -> None:
    models = {"walker": library()["pedestrian_child"], "pedestrian_child": library()["van"]}
    assert people(models, "child") == ["walker"]
    assert people(models, "senior") == ["walker"]
    assert people(library(), "senior") == ["pedestrian_senior_cap", "pedestrian_senior_coat"]


def test_every_vehicle_is_drawn_in_its_own_size() -> None:
    kinds = [kind.name for kind in VEHICLES]
    made = recording(kinds, row)
    for index, instance in enumerate(actors(made).at(0.0)):
        assert instance.model == kinds[index]
        points = corners(instance)
        size = points.max(axis=0) - points.min(axis=0)
        assert size[0] == pytest.approx(made.agents.length_m[index], abs=0.01)
        assert size[2] == pytest.approx(made.agents.height_m[index], abs=0.01)
        assert made.agents.width_m[index] - 0.01 < size[1] < made.agents.width_m[index] + 0.65  # mirrors
        assert points[:, 2].min() == pytest.approx(0.0, abs=0.01)


def test_a_users_vehicle_takes_the_nearest_model_and_its_own_size() -> None:
    made = recording(["passenger", "truck", "bicycle"], row)
    sizes = {"length_m": [4.2, 11.0, 1.8], "width_m": [1.75, 2.5, 0.6], "height_m": [1.5, 3.9, 1.7]}
    longer = {name: np.array(values, dtype=np.float32) for name, values in sizes.items()}
    made = replace(made, agents=replace(made.agents, **longer))
    drawn = actors(made).at(0.0)
    assert [each.model for each in drawn] == ["compact", "heavy_truck", "motorcycle"]
    for index, instance in enumerate(drawn):
        points = corners(instance)
        assert np.ptp(points[:, 0]) == pytest.approx(sizes["length_m"][index], abs=0.02)
        assert np.ptp(points[:, 2]) == pytest.approx(sizes["height_m"][index], abs=0.02)


def test_a_class_that_nobody_knows_is_a_car() -> None:
    assert vehicle_model("rickshaw_of_mars", np.array([4.9, 1.85, 1.45])) == "saloon"


def test_people_have_their_height_stand_on_the_ground_and_look_where_they_go() -> None:
    made = recording(["man", "woman", "child", "senior"], lambda agent, _: (9.0 * agent, 0.0, np.pi / 2, 0.0))
    for index, instance in enumerate(actors(made).at(0.0)):
        assert instance.model in people(library(), made.agents.kind[index])
        assert instance.part == "stand"
        points = corners(instance)
        assert np.ptp(points[:, 2]) == pytest.approx(made.agents.height_m[index], abs=0.01)
        assert points[:, 2].min() == pytest.approx(0.12, abs=0.01)
        assert instance.transform[:2, 0] @ (0, 1) > 0


def test_positions_between_frames_are_those_of_the_kernel() -> None:
    made = recording(["suv", "man"], lambda agent, t: (7.0 * t, 3.0 * agent + t * t / 9, 0.1 * t, 7.0))
    trace = trace_of(made)
    for time_s in (0.0, 0.26, 1.5, 3.33):
        poses = trace.agents_at(time_s)
        for index, instance in enumerate(actors(made).at(time_s)):
            assert instance.transform[0, 3] == pytest.approx(poses["x_m"][index], abs=1e-9)
            assert instance.transform[1, 3] == pytest.approx(poses["y_m"][index], abs=1e-9)


def test_only_what_reaches_into_the_disc_is_given() -> None:
    made = recording(["suv"] * 5, row)
    assert [labelled_agent(each.label) for each in actors(made).at(0.0, (14.0, 0.0, 5.0))] == [1]
    assert [each.label for each in actors(made).at(0.0)] == [agent_label(index) for index in range(5)]


@pytest.mark.parametrize("speed", [0.6, 1.4, 2.1])
def test_the_gait_follows_the_way_and_not_the_time(speed: float) -> None:
    made = recording(["man"], lambda _, t: (speed * t, 0.0, 0.0, speed))
    stage = actors(made)
    appearance = stage.appearance(0)
    times = np.linspace(0.0, 9.9, 397)
    parts = np.array([int(stage.at(time_s)[0].part.removeprefix("walk_")) for time_s in times])
    phase = (appearance.first_phase + speed * times / appearance.stride_m) % 1.0
    off = np.abs((parts / 8 - phase + 0.5) % 1.0 - 0.5)
    assert off.max() <= 1 / 16 + 1e-6
    assert set(parts) == set(range(8)) or speed < 1.0


@pytest.mark.parametrize("kind", ["man", "woman", "child", "senior"])
def test_planted_feet_do_not_slide(kind: str) -> None:
    """What touches the ground in one pose and in the next stays where it is, while the body goes an eighth further."""
    made = recording([kind], lambda _, t: (1.0 * t, 0.0, 0.0, 1.0))
    stage = actors(made)
    stride_m = stage.appearance(0).stride_m
    first = (1 - stage.appearance(0).first_phase) * stride_m
    poses = [stage.at((first + k * stride_m / 8) / 1.0)[0] for k in range(9)]
    assert [pose.part for pose in poses] == [f"walk_{k % 8}" for k in range(9)]
    slides = []
    for before, after in pairwise(poses):
        here, there = corners(before), corners(after)
        planted = (here[:, 2] < 0.12 + 0.012) & (there[:, 2] < 0.12 + 0.012)
        assert planted.sum() >= 3
        slides.append(float(np.median(np.abs(there[planted, 0] - here[planted, 0]))))
        assert np.abs(there[:, 0] - here[:, 0]).max() > stride_m / 8
    assert np.median(slides) < 0.005
    assert max(slides) < 0.07  # a heel rolls over its edge as it strikes


def test_a_person_who_stops_stands() -> None:
    made = recording(["woman"], lambda _, t: (1.3 * min(t, 4.0), 0.0, 0.0, 1.3 if t < 4.0 else 0.0))
    stage = actors(made)
    assert stage.at(2.0)[0].part.startswith("walk_")
    assert stage.at(8.0)[0].part == "stand"


@pytest.mark.parametrize(
    ("speed", "lit"),
    [
        (lambda _: 12.0, False),
        (lambda t: 12.0 - 2.0 * t, True),
        (lambda t: 12.0 - 0.3 * t, False),
        (lambda t: 2.0 + 1.5 * t, False),
        (lambda _: 0.0, True),
    ],
)
def test_brake_lamps_follow_deceleration(speed: Callable[[float], float], lit: bool) -> None:
    made = recording(["suv"], lambda _, t: (5.0 * t, 0.0, 0.0, speed(t)), frames=8)
    assert actors(made).at(1.2)[0].tints[1, 3] == (BRAKE_GLOW if lit else 0.0)


def test_a_style_depends_on_seed_and_number_alone() -> None:
    many = recording(["suv"] * 30 + ["man"] * 10, row).agents
    few = many.first(5)
    for agent in range(5):
        a, b = appearance_of(many, agent, 7, library()), appearance_of(few, agent, 7, library())
        assert a.model == b.model
        assert np.array_equal(a.tints, b.tints)
    colours = {appearance_of(many, agent, 7, library()).tints[0].tobytes() for agent in range(30)}
    assert len(colours) > 20
    other = [appearance_of(many, agent, 8, library()).tints[0].tobytes() for agent in range(30)]
    assert not colours & set(other)


def test_a_third_of_many_cars_are_white() -> None:
    many = recording(["compact"] * 600, row, frames=1).agents
    whites = [appearance_of(many, agent, 1, library()).tints[0, :3].min() > 0.55 for agent in range(600)]
    assert np.mean(whites) == pytest.approx(0.38, abs=0.06)


def test_the_quadrotor_leans_into_its_acceleration() -> None:
    level = quadrotor((1.0, 2.0, 9.0), 0.3)
    assert level.transform[:3, 2] == pytest.approx([0, 0, 1])
    assert level.transform[:2, 0] == pytest.approx([np.cos(0.3), np.sin(0.3)])
    leaning = quadrotor((0.0, 0.0, 9.0), 0.0, (9.81, 0.0, 0.0)).transform[:3, :3]
    assert leaning[:, 2] == pytest.approx([np.sqrt(0.5), 0, np.sqrt(0.5)])
    assert leaning.T @ leaning == pytest.approx(np.eye(3))
    assert np.linalg.det(leaning) == pytest.approx(1.0)


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
