"""Drives over the cross: on the road, clear of what stands, judged by the kernel, and the same again from the list."""

import json
from collections.abc import Sequence
from math import hypot

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.app.steering import BLOCKED, _played
from pavetwin.capture.platforms.car import REAR
from pavetwin.config import load_settings
from pavetwin.driving.car import CarState, Pedals
from pavetwin.driving.drive import DefectLooks, Drive, drive_again
from pavetwin.driving.road import RIM_M, DrivableRoad, body
from pavetwin.errors import PaveTwinError
from pavetwin.mission.by_hand import STEP_S, changes_as_values, changes_of_values
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.sensing import load_sensor
from pavetwin.world.model import LaneKind
from scenes import built, damaged
from scenes.tiny import CAR, Mover, TinyTraffic, parked, passing

SETTINGS = load_settings(altitude_m=10.0, sensing={"sensor": "ideal"})
AHEAD = Pedals(ahead=1.0)
STREET = "s0002"


@pytest.fixture(scope="module")
def environment() -> MissionEnvironment:
    world = damaged("cross", 8).world
    return prepare(world, SETTINGS, world.defects)


def drive_over(
    environment: MissionEnvironment, movers: Sequence[Mover] = (), sensor: str = "ideal", street: str = STREET
) -> Drive:
    settings = SETTINGS.model_copy(update={"sensing": SETTINGS.sensing.model_copy(update={"sensor": sensor})})
    return Drive(environment, TinyTraffic(movers), settings, load_sensor(settings.sensing, 1), street=street)


def driven(drive: Drive, pedals: Sequence[tuple[float, Pedals]]) -> Drive:
    """Each for so many seconds, and then to the end."""
    for seconds, each in pedals:
        for _ in range(round(seconds / STEP_S)):
            drive.step(each)
    while not drive.is_over:
        drive.step(Pedals(ends=True))
    return drive


TOUR = [(5.0, AHEAD), (1.0, Pedals(ahead=1.0, left=1.0)), (3.0, Pedals(ahead=-1.0, left=-1.0)), (4.0, AHEAD)]


def test_it_begins_on_a_lane_in_its_direction(environment: MissionEnvironment) -> None:
    state, world = drive_over(environment).state, environment.world
    lanes = [lane for lane in world.lanes if lane.kind is LaneKind.DRIVING]
    lane = min(lanes, key=lambda lane: lane.centre_line.distance(Point(state.x_m, state.y_m)))
    assert lane.edge in world.segment(STREET).edges
    assert lane.centre_line.distance(Point(state.x_m, state.y_m)) < 0.01
    stations = [lane.centre_line.project(Point(state.place(ahead))) for ahead in (0.0, 1.0)]
    assert stations[1] - stations[0] > 0.9


def test_it_stays_on_the_road_and_clear_of_what_stands(environment: MissionEnvironment) -> None:
    drive = driven(drive_over(environment), [*TOUR, (20.0, Pedals(ahead=1.0, is_fast=True)), (5.0, Pedals(ahead=-1.0))])
    world = environment.world
    surfaces = [*(each.polygon for each in world.segments), *(each.polygon for each in world.junctions)]
    road = shapely.union_all(surfaces).buffer(RIM_M + 0.01)
    houses = shapely.union_all([each.polygon for each in world.buildings])
    for state in drive.states:
        half_m, side_m = drive.limits.wheelbase_m / 2, drive.limits.track_m / 2
        wheels = [state.place(a, b) for a in (half_m, -half_m) for b in (side_m, -side_m)]
        assert road.covers(shapely.multipoints(wheels))
        assert not houses.intersects(body(state))
    assert drive.distance_m > 100


def test_at_the_end_of_the_map_it_stops_and_can_come_back(environment: MissionEnvironment) -> None:
    drive = drive_over(environment)
    blocked = False
    for _ in range(400):
        drive.step(AHEAD)
        blocked = blocked or drive.is_blocked
    assert blocked
    modes = _played(drive, drive.rows(), [])["missions"][0]["track"]["mode"]
    assert [mode == BLOCKED for mode in modes] == drive.stops, "played as it was driven"
    assert drive.state.speed_mps == 0.0
    at_end = drive.state
    for _ in range(30):
        drive.step(Pedals(ahead=-1.0))
    assert not drive.is_blocked
    assert hypot(drive.state.x_m - at_end.x_m, drive.state.y_m - at_end.y_m) > 2.0


def test_parked_vehicles_stop_it(environment: MissionEnvironment) -> None:
    """The same place is free with nothing parked."""
    world, standing = environment.world, environment.parked
    assert len(standing)
    drive = drive_over(environment)
    free = DrivableRoad(world, standing.empty(), drive.limits)
    blocked = 0
    for lane in world.lanes:
        if lane.kind is not LaneKind.DRIVING:
            continue
        for number in range(len(standing)):
            place = Point(standing.x[number], standing.y[number])
            if lane.centre_line.distance(place) > 3.5:
                continue
            here = CarState(place.x, place.y, float(standing.yaw_rad[number]))
            if free.holds(here):
                assert not drive.road.holds(here)
                blocked += 1
    assert blocked


def test_what_it_sees_is_what_the_kernel_sees_below_its_rear_camera(environment: MissionEnvironment) -> None:
    drive = driven(drive_over(environment), [(6.0, AHEAD)])
    across_m, along_m = drive.camera.window_m(REAR.z_m)
    assert (across_m, along_m) == pytest.approx((4.02, 3.01), abs=0.01)
    (row,) = drive.rows()
    strips = [
        shapely.Polygon([CarState(c.x_m, c.y_m, c.yaw_rad).place(a, b) for a, b in
                         ((along_m / 2, across_m / 2), (-along_m / 2, across_m / 2),
                          (-along_m / 2, -across_m / 2), (along_m / 2, -across_m / 2))])
        for c in drive.captures
    ]  # fmt: skip
    expected = shapely.union_all(strips).intersection(environment.world.segment(row.segment).polygon).area / row.area_m2
    assert row.surface_coverage == pytest.approx(expected, rel=0.05)
    gaps = np.hypot(*np.diff([(c.x_m, c.y_m) for c in drive.captures], axis=0).T)
    assert gaps.max() < along_m, "no gap between two images"
    for capture in drive.captures:
        assert (
            min(
                hypot(capture.x_m - state.place(REAR.x_m)[0], capture.y_m - state.place(REAR.x_m)[1])
                for state in drive.states
            )
            < 1e-9
        )


def test_it_finds_the_defects_in_its_images_and_names_why_others_are_missed(environment: MissionEnvironment) -> None:
    drive = driven(drive_over(environment, street="s0011"), [(12.0, AHEAD)])
    assert drive.confirmed, "the ideal sensor reports what is visible"
    least = SETTINGS.sensing.min_visible_fraction
    for number, time_s in drive.confirmed.items():
        assert drive.looks_at[number].visible >= least
        assert any(capture.time_s == time_s for capture in drive.captures)
    row = drive.rows()[0]
    assert row.segment == "s0011"
    here = environment.defects_by_segment[row.segment]
    assert row.found == sum(number in here for number in drive.confirmed)
    assert 0 < row.found < row.defects == len(here), "it saw one lane"
    missed = [number for number in here if number not in drive.looks_at]
    assert missed
    assert DefectLooks().reason(least) is MissReason.OUTSIDE_SWATH


def test_a_vehicle_on_a_defect_is_why_it_is_missed(environment: MissionEnvironment) -> None:
    alone = driven(drive_over(environment, street="s0011"), [(12.0, AHEAD)])
    number = next(iter(alone.confirmed))
    place = environment.defects[number].centre
    hidden = driven(drive_over(environment, [parked(place.x, place.y)], street="s0011"), [(12.0, AHEAD)])
    assert number not in hidden.confirmed
    assert hidden.looks_at[number].reason(SETTINGS.sensing.min_visible_fraction) is MissReason.HIDDEN_BY_VEHICLES
    assert hidden.looks_at[number].hidden_by()[MissReason.HIDDEN_BY_VEHICLES] > 0.5
    assert hidden.meetings == 1, "the car drove over it"


def test_recorded_traffic_hides_the_road_and_drives_through_it(environment: MissionEnvironment) -> None:
    start = drive_over(environment).state
    camera = start.place(REAR.x_m)
    drive = drive_over(environment, [passing(*camera, 0.01, CAR), passing(start.x_m, start.y_m, 0.0, CAR, from_s=0.0)])
    drive.step(Pedals())
    assert drive.is_met
    assert drive.meetings == 2
    assert drive.looks[-1] == 0.0, "a camera inside a body sees nothing"
    drive.step(Pedals())
    assert drive.meetings == 2, "the same two"
    alone = drive_over(environment)
    alone.step(Pedals())
    assert not alone.is_met
    assert alone.looks[-1] == 1.0


def test_the_same_pedals_drive_the_same_again(environment: MissionEnvironment) -> None:
    drive = driven(drive_over(environment, sensor="calibrated"), TOUR)
    kept = changes_of_values(json.loads(json.dumps(changes_as_values(drive.changes))), Pedals)
    assert kept == drive.changes
    again = drive_over(environment, sensor="calibrated")
    drive_again(again, kept)
    assert again.states == drive.states
    assert again.rows() == drive.rows()
    assert again.confirmed == drive.confirmed


def test_the_traffic_is_recorded_further_when_the_drive_lasts(environment: MissionEnvironment) -> None:
    traffic = TinyTraffic([], duration_s=2.0)
    drive = Drive(environment, traffic, SETTINGS, load_sensor(SETTINGS.sensing, 1), street=STREET)
    driven(drive, [(5.0, AHEAD)])
    assert traffic.duration_s >= drive.time_s


def test_it_begins_on_the_side_on_which_one_drives() -> None:
    world = built("cross").world
    bare = prepare(world, SETTINGS, ())
    state = Drive(bare, TinyTraffic([]), SETTINGS, load_sensor(SETTINGS.sensing, 1), street=STREET).state
    segment = world.segment(STREET)
    line = segment.centre_line
    at = line.project(Point(state.x_m, state.y_m))
    here, ahead = line.interpolate(at), line.interpolate(at + 0.5)
    along = (ahead.x - here.x) * np.cos(state.yaw_rad) + (ahead.y - here.y) * np.sin(state.yaw_rad)
    side = (ahead.x - here.x) * (state.y_m - here.y) - (ahead.y - here.y) * (state.x_m - here.x)
    assert np.sign(side * along) == (1 if world.left_hand else -1)


def test_a_sensor_that_looks_afterwards_is_refused(environment: MissionEnvironment) -> None:
    with pytest.raises(PaveTwinError, match="answers at once"):
        drive_over(environment, sensor="detector")
