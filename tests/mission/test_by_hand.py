"""Flights by hand over the cross: within the limits, home by itself, and the same again from the list of sticks."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shapely import Point

from pavetwin.config import load_settings
from pavetwin.mission.by_hand import PILOT, STEP_S, ByHand, Stick, changes_as_values, changes_of_values, fly_again
from pavetwin.mission.environment import MissionEnvironment, inspect_speed_mps, prepare
from pavetwin.mission.events import BatteryRanLow, DefectsConfirmed, SegmentFinished, SegmentStarted
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Sensor, load_sensor
from scenes import damaged
from scenes.tiny import TinyTraffic

SETTINGS = load_settings(altitude_m=10.0)
AHEAD = Stick(ahead=1.0)


@pytest.fixture(scope="module")
def environment() -> MissionEnvironment:
    world = damaged("cross", 8).world
    return prepare(world, SETTINGS, world.defects)


def flight_over(environment: MissionEnvironment, **more: object) -> tuple[ByHand, Sensor]:
    settings = SETTINGS.model_copy(update=more)
    sensor = load_sensor(settings.sensing, 1)
    flight = ByHand(environment, TinyTraffic([]), settings, [], policy=PILOT, sensor=sensor.name)
    return flight, sensor


def flown(flight: ByHand, sensor: Sensor, sticks: list[tuple[float, Stick]]) -> None:
    """Each stick for so many seconds, and then home."""
    for seconds, stick in sticks:
        for _ in range(round(seconds / STEP_S)):
            flight.step(stick, sensor)
    while not flight.is_over:
        flight.step(Stick(lands=True), sensor)


TOUR = [
    (6.0, Stick()),
    (8.0, AHEAD),
    (2.0, Stick(turn=1.0)),
    (6.0, Stick(ahead=1.0, is_fast=True)),
    (1.0, Stick(left=-1.0)),
]


def same(one: MissionResult, other: MissionResult) -> bool:
    tracks = [{name: np.asarray(column) for name, column in each.track.items()} for each in (one, other)]
    return one.rows == other.rows and all(
        np.array_equal(tracks[0][name], tracks[1][name], equal_nan=tracks[0][name].dtype.kind == "f")
        for name in tracks[0]
    )


def test_a_flight_shows_what_it_flies_over_and_ends_at_its_base(environment: MissionEnvironment) -> None:
    flight, sensor = flight_over(environment)
    flown(flight, sensor, TOUR)
    result = flight.result(1)
    track, base = result.track, environment.world.base
    assert Point(track["x_m"][-1], track["y_m"][-1]).distance(base) < 1.0
    assert flight.state().altitude_m == 0.0
    assert max(track["altitude_m"]) == SETTINGS.altitude_m, "at the altitude of its flight domain"
    assert max(track["speed_mps"]) <= SETTINGS.uav.transit_speed_mps + 1e-6
    assert max(track["speed_mps"]) > inspect_speed_mps(SETTINGS)
    assert all(environment.mesh.contains(x, y) for x, y in zip(track["x_m"], track["y_m"], strict=True))
    assert result.rows
    assert [row.segment for row in result.rows] == list(result.spec.targets)
    assert any(row.surface_coverage > 0.05 for row in result.rows)
    assert result.policy == PILOT


def test_its_rows_add_up_and_count_what_was_found(environment: MissionEnvironment) -> None:
    flight, sensor = flight_over(environment)
    flown(flight, sensor, [*TOUR, (2.0, Stick(turn=-1.0)), (6.0, Stick(ahead=-1.0))])
    result = flight.result(1)
    started = [event.segment for event in result.events if isinstance(event, SegmentStarted)]
    finished = [event for event in result.events if isinstance(event, SegmentFinished)]
    assert len(set(started)) == len(started) == len(finished) == len(result.rows), "each segment once"
    assert sum(row.time_s for row in result.rows) == pytest.approx(finished[0].time_s)
    found = {number for event in result.events if isinstance(event, DefectsConfirmed) for number in event.defects}
    assert found == set(result.memory.confirmed)
    looked_at = {environment.world.segments[index].id for index in started}
    here = [number for number in found if environment.defects[number].segment in looked_at]
    assert sum(row.confirmed for row in result.rows) == len(here)
    for row in result.rows:
        number = started[row.order]
        assert row.surface_coverage == flight.flight.surface_coverage(number)


def test_the_same_sticks_fly_the_same(environment: MissionEnvironment) -> None:
    flight, sensor = flight_over(environment)
    flown(flight, sensor, TOUR)
    written = json.loads(json.dumps(changes_as_values(flight.changes)))
    assert changes_of_values(written, Stick) == flight.changes
    assert len(written) == len(TOUR) + 1, "changes alone are kept"
    again, other = flight_over(environment)
    fly_again(again, changes_of_values(written, Stick), other)
    assert same(flight.result(1), again.result(1))


def test_a_low_battery_ends_the_flight_at_home(environment: MissionEnvironment) -> None:
    energy = SETTINGS.energy.model_copy(update={"reserve": 0.9})
    flight, sensor = flight_over(environment, energy=energy)
    while not flight.is_over:
        flight.step(AHEAD, sensor)
    result = flight.result(1)
    assert any(isinstance(event, BatteryRanLow) for event in result.events)
    assert result.track["battery"][-1] >= 0.9
    assert flight.coverage() == {row.segment: row.surface_coverage for row in result.rows}
    assert not any(change.input.lands for change in flight.changes)


def test_a_flight_ends_after_landing(environment: MissionEnvironment) -> None:
    flight, sensor = flight_over(environment)
    for stick in (*[AHEAD] * 60, replace(AHEAD, lands=True), *[AHEAD] * 5):
        flight.step(stick, sensor)
    assert flight.changes[-1].input.lands
    while not flight.is_over:
        flight.step(Stick(), sensor)
    assert flight.state().altitude_m == 0.0
