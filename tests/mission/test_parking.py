"""Missions next to parked vehicles: what they hide stays hidden, and no policy waits for it."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point

from pavetwin._core import Occluded, Viewpoint
from pavetwin.arrays import BoolArray, Float64Array
from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission import Mission, MissionInputs, Timeline, fly, plan_mission, prepare, totals
from pavetwin.mission.environment import (
    FIRST_ID,
    ParkingInput,
    Surroundings,
    nadir_camera,
)
from pavetwin.mission.fly import fly_over
from pavetwin.mission.inspected_defects import MissReason, PolicyResponse, inspected_defects
from pavetwin.mission.spec import MissionSpec
from pavetwin.policies import policy_names
from pavetwin.twin import Agent
from pavetwin.uav import camera_of
from scenes.parking import EMPTY, FULL, full_street, kerb_place, narrow_street, with_places
from scenes.tiny import TRUCK, Scene, parked, straight, trace_of

POLICIES = policy_names()
CAR_PLACE = kerb_place(30, 0)
SETTINGS = Scene(straight()).settings()
CAMERA = nadir_camera(camera_of(SETTINGS), SETTINGS.camera)
SURROUNDINGS = Surroundings.of(straight(), 6.0, Scene(straight()).settings().uav)
ENVIRONMENT = prepare(straight(), Scene(straight()).settings(), (), SURROUNDINGS)


@pytest.mark.parametrize("policy", POLICIES)
def test_no_policy_reacts_to_a_car_parked_over_a_defect(policy: str) -> None:
    ours = narrow_street().fly(policy, FULL)
    (row,) = ours.rows
    assert (row.wait_s, row.revisits, row.occlusions, ours.actions) == (0.0, 0, 0, ())
    hidden, free = inspected_defects(ours)
    assert free.is_found
    assert hidden.reason is MissReason.HIDDEN_BY_PARKED_VEHICLES
    assert hidden.responses == (PolicyResponse.NOT_ASKED,)
    assert hidden.hidden_by is not None
    assert hidden.hidden_by[MissReason.HIDDEN_BY_PARKED_VEHICLES] == 1.0
    assert hidden.hidden_by[MissReason.HIDDEN_BY_VEHICLES] == 0.0


def test_the_same_car_standing_in_traffic_is_waited_for() -> None:
    """The scenes above differ only in the parked car."""
    standing = replace(narrow_street(), movers=(parked(30, 0.0),))
    ours = standing.fly("hover", EMPTY, "policy.max_wait_s=10")
    assert ours.rows[0].wait_s >= 10.0
    assert inspected_defects(ours)[0].reason is MissReason.HIDDEN_BY_VEHICLES


def test_next_to_a_parked_car_hover_waits_only_for_the_moving_one() -> None:
    crossing = replace(narrow_street(), movers=(parked(36, -0.2, until_s=25.0),))
    ours = crossing.fly("hover", FULL)
    alone = replace(crossing, world=straight(width_m=4.0)).fly("hover")
    assert 0 < ours.rows[0].wait_s < 25.0
    assert abs(ours.rows[0].wait_s - alone.rows[0].wait_s) <= 4.0
    assert ours.duration_s < 60.0


def test_the_surface_next_to_parked_cars_is_all_that_can_be_seen() -> None:
    ours, empty = full_street().fly("hover", FULL), full_street().fly("hover", EMPTY)
    (row,), (free,) = ours.rows, empty.rows
    assert 0.15 < row.permanently_hidden < 0.5
    assert row.surface_coverage <= 1 - row.permanently_hidden
    assert row.surface_coverage == pytest.approx(1 - row.permanently_hidden, abs=0.02)
    assert row.inspected, "95 % of what can be seen"
    assert (free.permanently_hidden, free.surface_coverage) == (0.0, 1.0)
    assert totals(ours).permanently_hidden == row.permanently_hidden
    assert totals(empty).permanently_hidden == 0.0


def test_under_the_cars_nothing_is_seen_and_between_them_something() -> None:
    """Every permanently hidden cell is under a car or close to it, on the far side of a pass."""
    scene = full_street()
    settings_ = scene.settings(FULL)
    environment = scene.environment(settings_)
    hidden_m2 = environment.permanently_hidden(0, settings_) * 12 * 60
    stands = environment.parked
    under_m2 = float((stands.length_m * stands.width_m).sum())
    assert under_m2 * 0.9 < hidden_m2 < under_m2 * 2.0
    narrow_m2 = environment.permanently_hidden(0, scene.settings(FULL, "camera.window_columns=0.1")) * 12 * 60
    assert under_m2 * 0.9 < narrow_m2 < hidden_m2, "more passes look from straighter above"


def test_where_cars_fill_the_window_no_policy_is_asked() -> None:
    """C is empty: the whole window lies under a row of vehicles across the street."""
    places = [kerb_place(30, y, name=f"x{y}", yaw_rad=0.0, length_m=6.0, width_m=2.0) for y in np.arange(-8, 8.1, 2)]
    scene = Scene(with_places(straight(width_m=2.0), *places), movers=(parked(30, 0),))
    settings_ = scene.settings(FULL, "camera.window_rows=0.05")
    ours = fly_over(scene.environment(settings_), scene.traffic(), settings_, [0], "hover")
    assert np.isnan(ours.captures["visibility"]).any()
    assert ours.rows[0].wait_s == 0.0


def test_a_loading_bay_is_empty_at_one_hour_and_full_at_another() -> None:
    """In a street of houses 73 % of the places are taken at noon, 92 % at night. Under some seeds this one is, at night
    alone."""
    scene = narrow_street()

    def stands(seed: int, clock: str) -> int:
        return len(
            ParkingInput.of(scene.settings("parking.enabled=true", f"conditions.time='{clock}'"), seed).vehicles(
                scene.world
            )
        )

    seed = next(seed for seed in range(200) if stands(seed, "12:00") < stands(seed, "02:00"))

    def found(clock: str) -> list[bool]:
        settings_ = scene.settings("parking.enabled=true", f"conditions.time='{clock}'")
        environment = prepare(scene.world, settings_, parking_seed=seed)
        flown = fly_over(environment, scene.traffic(), settings_, [0], "baseline")
        return [each.is_found for each in inspected_defects(flown)]

    assert (found("12:00"), found("02:00")) == ([True, True], [False, True])


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize(
    ("day", "clock", "is_free"),
    [("2026-06-22", "12:00", True), ("2026-06-22", "18:00", False), ("2026-06-21", "12:00", False)],
)
def test_a_loading_bay_shows_its_defect_at_its_hours_alone(policy: str, day: str, clock: str, is_free: bool) -> None:
    """A Monday at noon, after hours, and a Sunday; out of its hours everybody parks there."""
    scene = narrow_street()
    (place,) = scene.world.parking
    bay = Scene(with_places(scene.world, replace(place, closed="Mo-Fr 07:00-17:00")))
    ours = bay.fly(policy, FULL, f"conditions.date={day}", f"conditions.time='{clock}'")
    assert inspected_defects(ours)[0].is_found == is_free
    assert (ours.rows[0].permanently_hidden == 0.0) == is_free
    assert ours.rows[0].wait_s == 0.0


def test_what_is_parked_depends_on_the_seed_and_is_the_same_under_every_policy() -> None:
    scene = full_street()
    settings_ = scene.settings("parking.occupancy=0.5")
    environments = [prepare(scene.world, settings_, parking_seed=seed) for seed in (1, 1, 2)]
    places = [environment.parked.place.tolist() for environment in environments]
    assert places[0] == places[1] != places[2]
    results = [fly_over(environments[0], scene.traffic(), settings_, [0], policy) for policy in POLICIES]
    assert len({result.rows[0].permanently_hidden for result in results}) == 1
    assert {result.spec.parking_seed for result in results} == {1}


def test_an_environment_with_other_parked_vehicles_is_refused() -> None:
    scene = full_street()
    settings_ = scene.settings("parking.occupancy=0.5")
    environment = prepare(scene.world, settings_, parking_seed=1)
    spec = fly_over(environment, scene.traffic(), settings_, [0], "baseline").spec
    inputs = MissionInputs(environment, scene.traffic())
    for change in (
        {"parking_seed": 2},
        {"settings": scene.settings("parking.occupancy=0.6")},
        {"settings": scene.settings("parking.occupancy=0.5", "conditions.time='11:00'")},
    ):
        with pytest.raises(PaveTwinError, match="the parking differs"):
            fly(spec.model_copy(update=change), inputs=inputs)
    wind = scene.settings("parking.occupancy=0.5", "conditions.wind_mps=1")
    assert fly(spec.model_copy(update={"settings": wind}), inputs=inputs).rows


def test_a_mission_parks_the_mix_of_its_traffic() -> None:
    scene = full_street()
    settings_ = load_settings(altitude_m=10.0, parking={"occupancy": 1.0})

    def parked_by(density: str) -> tuple[MissionSpec, set[str]]:
        spec = plan_mission(scene.world, settings_, density=density, segments=1, seed=3)
        parking = ParkingInput.of(settings_, spec.parking_seed, spec.parking_mix)
        return spec, set(parking.vehicles(scene.world).kind)

    spec, kinds = parked_by("los-C+east_asia")
    assert "scooter" in kinds
    assert "scooter" not in parked_by("los-C")[1]
    environment = prepare(scene.world, settings_, parking_seed=3, parking_mix="east_asia")
    assert set(environment.parked.kind) == kinds
    flown = fly_over(environment, scene.traffic(), settings_, [0], "baseline").spec
    assert flown.parking_mix == spec.parking_mix == "east_asia"
    with pytest.raises(PaveTwinError, match="the parking differs"):
        fly(flown.model_copy(update={"parking_mix": "europe"}), inputs=MissionInputs(environment, scene.traffic()))


def test_a_policy_sees_what_is_parked_and_how_much_it_hides() -> None:
    scene = replace(full_street(), movers=(parked(30, 0, TRUCK),))
    settings_ = scene.settings(FULL)
    environment = scene.environment(settings_)
    mission = Mission(environment, scene.traffic(), settings_, [0], policy="watched")
    event = next(event for event in mission if isinstance(event, Occluded))
    snapshot = mission.snapshot(event)
    assert snapshot.occlusion is not None
    assert 0.1 < snapshot.occlusion.permanently_hidden < 0.6
    assert len(snapshot.agents) == 1
    assert not snapshot.agents[0].is_parked
    assert len(snapshot.parked) == len(environment.parked) == 20
    assert all(agent.is_parked and agent.velocity_mps == (0.0, 0.0) for agent in snapshot.parked)
    assert min(agent.id for agent in snapshot.parked) >= FIRST_ID
    where = mission.flight
    eye = Viewpoint(position=where.position, altitude_m=where.altitude_m, yaw_rad=where.yaw_rad)
    look = environment.ground.observe(
        0, mission.traffic.trace(), event.time_s, nadir_camera(camera_of(settings_), settings_.camera), eye
    )
    assert snapshot.occlusion.permanently_hidden == look["permanently_hidden"]


def test_a_timeline_shows_parked_vehicles() -> None:
    ours = full_street().fly("baseline", FULL)
    timeline = Timeline(ours)
    assert timeline.at(5.0).parked == ours.environment.parked_agents
    assert timeline.parked["x_m"].tolist() == ours.environment.parked.x.tolist()


def test_the_paper_preset_parks_nothing() -> None:
    scene = full_street()
    ours, bare = (
        scene.fly("hover", preset="paper"),
        replace(scene, world=with_places(scene.world)).fly("hover", preset="paper"),
    )
    assert not len(ours.environment.parked)
    assert ours.rows == bare.rows


poses = st.tuples(st.floats(-8, 8), st.floats(-5, 5), st.floats(-pi, pi))
eyes = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(5, 20), st.floats(-pi, pi))


@settings(max_examples=40, deadline=None)
@given(st.lists(poses, min_size=1, max_size=4), eyes)
def test_the_cells_left_by_parked_vehicles_are_those_that_a_ray_reaches(
    places: list[tuple[float, float, float]], eye: tuple[float, float, float, float]
) -> None:
    """Ray by ray in three dimensions, against the boxes of the vehicles as they are drawn and given to policies."""
    x, y, altitude_m, yaw_rad = eye
    scene, bare = Scene(straight()), ENVIRONMENT
    world = with_places(
        scene.world, *(replace(CAR_PLACE, centre=Point(30 + east, north), yaw_rad=yaw) for east, north, yaw in places)
    )
    environment = prepare(world, scene.settings(FULL), (), SURROUNDINGS)
    camera, view = CAMERA, Viewpoint(position=(30 + x, y), altitude_m=altitude_m, yaw_rad=yaw_rad)
    trace = trace_of((), 1.0)
    all_cells = bare.ground.observe(0, trace, 0.0, camera, view)["candidates"]
    look = environment.ground.observe(0, trace, 0.0, camera, view)
    left = {tuple(cell) for cell in look["candidates"].tolist()}
    surely, maybe = (blocked(environment.parked_agents, view, all_cells, slack_m) for slack_m in (-1e-5, 1e-5))
    for cell, is_hidden, may_be_hidden in zip(all_cells.tolist(), surely, maybe, strict=True):
        if is_hidden == may_be_hidden:
            assert (tuple(cell) not in left) == is_hidden
    count = len(all_cells)
    assert look["permanently_hidden"] == pytest.approx((count - len(left)) / count if count else 0.0)


def blocked(vehicles: tuple[Agent, ...], view: Viewpoint, cells: Float64Array, slack_m: float) -> BoolArray:
    """(n,) whether the line from the camera to each cell meets a box that is larger by `slack_m` on every side."""
    hidden = np.zeros(len(cells), dtype=bool)
    start = np.array([*view.position, view.altitude_m])
    for vehicle in vehicles:
        c, s = np.cos(vehicle.yaw_rad), np.sin(vehicle.yaw_rad)
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        centre = np.array([*vehicle.position, vehicle.height_m / 2])
        half = np.array([vehicle.length_m, vehicle.width_m, vehicle.height_m]) / 2 + slack_m
        begin = turn @ (start - centre)
        run = (np.column_stack([cells, np.zeros(len(cells))]) - centre) @ turn.T - begin
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (-half - begin) / run, (half - begin) / run
        enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        hidden |= np.maximum(enter, 0.0) <= np.minimum(leave, 1.0 - 1e-9)
    return hidden


def test_a_base_on_a_parked_vehicle_is_refused() -> None:
    scene = Scene(replace(straight(), base=Point(30, 0)))
    bare = scene.environment().world.base
    world = with_places(scene.world, kerb_place(bare.x, bare.y))
    ours = prepare(world, scene.settings()).world.base
    assert world.parking[0].polygon.distance(ours) >= 1.49
    with pytest.raises(PaveTwinError, match=r"a standing object leaves no room \(parked vehicle\)"):
        prepare(world, scene.settings(FULL), base=bare)
    assert prepare(world, scene.settings(EMPTY), base=bare).world.base == bare


def test_a_plan_parks_by_its_traffics_seed() -> None:
    scene = full_street()
    settings_ = load_settings(altitude_m=10.0, parking={"occupancy": 0.5})
    spec = plan_mission(scene.world, settings_, segments=1, seed=3)
    other = plan_mission(scene.world, settings_, segments=1, seed=3, traffic_seed=8)
    assert (spec.parking_seed, other.parking_seed) == (3, 8)
    assert spec.settings.parking.occupancy == 0.5
