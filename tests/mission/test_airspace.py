"""Other aircraft at the UAV's own altitude: kept clear of; elsewhere: not even noticed."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pavetwin._core import Trace
from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission import choose_targets, prepare, totals
from pavetwin.mission.airspace import SPAN_M, Aircraft, load_airspace, with_aircraft
from pavetwin.mission.fly import fly_over
from pavetwin.mission.result import MissionResult
from pavetwin.traffic.trace import TraceArguments, trace_arguments
from scenes import damaged, tiny
from scenes.recordings import recording

HEADER = "aircraft,t_s,x_m,y_m,altitude_m\n"
ALTITUDE_M = 6.0
FRAMES = 1201


def empty_sky() -> TraceArguments:
    return trace_arguments(recording([], lambda *_: (0.0, 0.0, 0.0, 0.0), FRAMES))


class Sky:
    """Nothing on the ground, aircraft above it."""

    def __init__(self, aircraft: Sequence[Aircraft]) -> None:
        self._trace = Trace.of_parts(**with_aircraft(empty_sky(), aircraft))

    def trace(self) -> Trace:
        return self._trace

    def extend(self, needed_s: float) -> Trace:
        raise AssertionError(f"ten minutes must do, not {needed_s} s")


def aircraft(*points: tuple[float, float, float], altitude_m: float = ALTITUDE_M) -> Aircraft:
    """A track of (time, east, north)."""
    track = np.array(points)
    return Aircraft("other", track[:, 0], track[:, 1:], altitude_m)


def flown_among(*others: Aircraft) -> MissionResult:
    scene = tiny.empty_street((30.0, 1.0))
    settings = scene.settings("pattern.kind=out_and_back")
    return fly_over(scene.environment(settings), Sky(others), settings, [0], "baseline")


def nearest_m(result: MissionResult, other: Aircraft) -> float:
    """The smallest distance between the two centres at the track's times, while the UAV is in the air."""
    track = result.track
    aloft = (track["altitude_m"] > ALTITUDE_M - 1) & (track["t_s"] <= other.t_s[-1])
    x, y = (np.interp(track["t_s"], other.t_s, other.xy_m[:, axis]) for axis in (0, 1))
    return float(np.hypot(track["x_m"] - x, track["y_m"] - y)[aloft].min())


HANGS = aircraft((0, 30, -1.75), (600, 30, -1.75))
OPPOSES = aircraft((0, 150, -1.75), (10, 100, -1.75), (60, -150, -1.75))


@pytest.mark.parametrize("other", [HANGS, OPPOSES], ids=["hangs in the way", "comes head on"])
def test_an_aircraft_at_the_same_altitude_is_kept_clear_of(other: Aircraft) -> None:
    clear = 0.5 + SPAN_M / 2
    alone = flown_among()
    assert nearest_m(alone, other) < clear  # alone it would have flown into it
    together = flown_among(other)
    assert nearest_m(together, other) > clear
    assert together.rows[0].surface_coverage > 0.9
    assert (together.track["mode"] == 10).any()
    assert together.duration_s < alone.duration_s + 120


@pytest.mark.parametrize("altitude_m", [ALTITUDE_M - 2.0, ALTITUDE_M + 2.0])
def test_an_aircraft_above_or_below_is_passed_by(altitude_m: float) -> None:
    other = aircraft((0, 30, -1.75), (600, 30, -1.75), altitude_m=altitude_m)
    alone, together = flown_among(), flown_among(other)
    for column in ("x_m", "y_m", "yaw_rad", "battery"):
        np.testing.assert_array_equal(alone.track[column], together.track[column])


def test_aircraft_come_first_so_that_extending_keeps_the_numbering() -> None:
    ground = tiny.trace_of([tiny.parked(10, 0)], 5.0)
    assert ground.agents_at(0.0)["agent"].tolist() == [0]
    merged = Trace.of_parts(**with_aircraft(empty_sky(), [HANGS, OPPOSES]))
    poses = merged.agents_at(30.0)
    assert poses["agent"].tolist() == [0, 1]
    np.testing.assert_allclose(poses["x_m"], [30.0, 0.0], atol=1e-3)


def test_a_table_of_aircraft_is_read(tmp_path: Path) -> None:
    file = tmp_path / "air.csv"
    file.write_text(HEADER + "a,0,0,0,10\na,10,50,0,10\nb,5,1,2,12\nb,6,2,2,12\n")
    first, second = load_airspace(file)
    assert (first.name, first.altitude_m, second.name) == ("a", 10.0, "b")
    np.testing.assert_array_equal(second.xy_m, [[1, 2], [2, 2]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("aircraft,t_s,x_m,y_m\na,0,0,0\n", "altitude_m"),
        (HEADER.replace(",", ";"), "separated by ';'"),
        (HEADER.replace(",", "\t"), "separated by tabs"),
        (HEADER + "a,0,0,0,10\n", "two points"),
        (HEADER + "a,5,0,0,10\na,5,1,0,10\n", "rising"),
        (HEADER + "a,0,0,0,10\na,1,1,0,11\n", "altitude changes"),
        (HEADER + "a,0,zero,0,10\na,1,1,0,10\n", "numbers"),
        ("", "not a CSV"),
    ],
)
def test_a_table_that_is_none_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "air.csv"
    file.write_text(text)
    with pytest.raises(PaveTwinError, match=words) as caught:
        load_airspace(file)
    assert "\n" not in str(caught.value)


def test_an_aircraft_that_stands_anywhere_on_the_route_is_flown_round() -> None:
    """In a town, where corners, trees and the ends of passes leave less room than a straight street."""
    world = damaged("town", 4).world
    settings = load_settings("default", altitude_m=ALTITUDE_M, uav={"base": "street"})
    environment = prepare(world, settings)
    targets = choose_targets(environment, count=3, seed=1)
    alone = fly_over(environment, Sky([]), settings, targets, "hover")
    aloft = np.flatnonzero(alone.track["altitude_m"] == ALTITUDE_M)
    for row in np.linspace(aloft[40], aloft[-40], 4).astype(int):
        x, y = float(alone.track["x_m"][row]), float(alone.track["y_m"][row])
        other = aircraft((0, x, y), (600, x, y))
        together = fly_over(environment, Sky([other]), settings, targets, "hover")
        assert nearest_m(together, other) > 0.5 + SPAN_M / 2
        assert together.duration_s < alone.duration_s + 60
        assert together.swaps == 0
        assert totals(together).surface_coverage > totals(alone).surface_coverage - 0.02


def test_an_aircraft_that_never_lets_it_pass_does_not_cost_the_battery() -> None:
    """A swarm closes the street: the UAV waits, goes home in time, and reports that it cannot get there."""
    wall = [aircraft((0, 30, y), (600, 30, y)) for y in np.arange(-9.0, 9.5, 0.8)]
    scene = tiny.empty_street((30.0, 1.0))
    settings = scene.settings("pattern.kind=out_and_back", "energy.model=linear", "energy.endurance_s=200")
    with pytest.raises(PaveTwinError, match="One battery is too small"):
        fly_over(scene.environment(settings), Sky(wall), settings, [0], "baseline")
