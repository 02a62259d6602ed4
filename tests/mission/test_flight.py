"""The kernel's flight by itself: commands in, events out, and pauses that change nothing."""

from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest

from pavetwin._core import Arrived, Captured, Flight, Occluded, Paused
from pavetwin.mission.environment import new_flight
from pavetwin.mission.track import MODES
from pavetwin.twin import Mode
from scenes.tiny import CAR, TRUCK, Scene, Size, lively_street, parked, passing, straight

Event = Captured | Occluded

TALL = Size(3.0, 2.0, 7.0)
"""Reaches the usual altitude of 6 m."""


def busy_street() -> Scene:
    """Everything a flight can meet: cars to wait for, a truck to look around, and something as high as the UAV."""
    movers = (*lively_street().movers, parked(20, 1.75, TRUCK, until_s=60), passing(130, 0.3, -1.5, TALL))
    return Scene(straight(*((6.0 * k, 1.75 - 1.75 * (k % 3)) for k in range(1, 10))), movers)


def flown(scene: Scene, *, pause_s: float | None = None, every_capture: bool = False) -> tuple[Flight, list[Event]]:
    """Out and back over the street, with a revisit; every other answer to an occlusion is a wait or a displacement."""
    settings = scene.settings()
    trace = scene.traffic().trace()
    flight = new_flight(scene.environment(settings), trace, settings, every_capture=every_capture)
    events: list[Event] = []
    answers = count()

    def run() -> None:
        for event in advanced(flight, pause_s):
            events.append(event)
            if isinstance(event, Occluded):
                match next(answers) % 8:
                    case 0 | 3:
                        flight.wait(1.3)
                    case 5:
                        flight.displace(0.5, -1.0, 0.7)

    flight.climb_to(scene.altitude_m)
    run()
    for line in ([[3.0, 1.0], [57.0, 1.0]], [[57.0, -1.0], [3.0, -1.0]]):
        flight.fly_to((line[0][0], line[0][1]))
        run()
        flight.inspect(0, np.array(line))
        run()
    flight.fly_to((30.0, 0.0), revisit=True, stop_short=True)
    run()
    flight.revisit(0, 2.0)
    run()
    flight.fly_home()
    run()
    flight.climb_to(0.0)
    run()
    return flight, events


def advanced(flight: Flight, pause_s: float | None) -> Iterator[Event]:
    """Events up to the arrival, with a pause every so often."""
    until_s = None if pause_s is None else flight.time_s
    while not isinstance(event := flight.advance(until_s), Arrived):
        if isinstance(event, Paused):
            assert until_s is not None
            assert pause_s is not None
            assert until_s - 1e-9 <= flight.time_s < until_s + 0.05
            until_s = flight.time_s + pause_s
        else:
            assert isinstance(event, Captured | Occluded)
            yield event


def values(event: Event) -> tuple[object, ...]:
    return tuple(getattr(event, name) for name in sorted(vars(type(event))) if not name.startswith("_"))


@pytest.mark.parametrize("pause_s", [0.0501, 0.37, 11.0])
def test_a_flight_in_pieces_is_the_flight_in_one(pause_s: float) -> None:
    whole, events = flown(busy_street(), every_capture=True)
    pieces, same = flown(busy_street(), pause_s=pause_s, every_capture=True)
    met = set(whole.track()["mode"])
    assert {MODES.index(mode) for mode in (Mode.WAIT, Mode.DISPLACE, Mode.REVISIT, Mode.AVOID)} <= met
    for ours, theirs in ((whole.track(), pieces.track()), (whole.captures(), pieces.captures())):
        assert ours.keys() == theirs.keys()
        for name in ours:
            np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    assert list(map(values, events)) == list(map(values, same))
    for name in ("time_s", "position", "battery", "energy_used", "distance_m", "waited_s", "occlusions"):
        assert getattr(whole, name) == getattr(pieces, name), name
    np.testing.assert_array_equal(whole.swept(), pieces.swept())
    assert whole.surface_coverage(0) == pieces.surface_coverage(0)


def test_a_pause_ends_at_the_first_step_not_before_it() -> None:
    scene = Scene(straight())
    flight = new_flight(scene.environment(), scene.traffic().trace(), scene.settings())
    flight.climb_to(6.0)
    for until_s, reached_s in ((0.0, 0.0), (0.3, 0.3), (0.31, 0.35), (0.1, 0.35)):
        assert isinstance(flight.advance(until_s), Paused)
        assert flight.time_s == pytest.approx(reached_s, abs=1e-9)
    assert flight.altitude_m == pytest.approx(0.35 * 3.0)
    assert isinstance(flight.advance(60.0), Arrived)
    assert flight.time_s == pytest.approx(2.0)


def test_every_capture_is_an_event_when_asked_for() -> None:
    flight, events = flown(busy_street(), every_capture=True)
    captured = [event for event in events if isinstance(event, Captured)]
    log = flight.captures()
    assert [event.number for event in captured] == list(range(len(log["t_s"])))
    assert [event.time_s for event in captured] == list(log["t_s"])
    assert [event.position for event in captured] == list(zip(log["x_m"], log["y_m"], strict=True))
    assert [event.segment for event in captured] == list(log["segment"])
    assert [event.on_revisit for event in captured] == list(log["on_revisit"])
    visibility = [np.nan if event.visibility is None else event.visibility for event in captured]
    np.testing.assert_array_equal(visibility, log["visibility"])
    assert any(event.on_revisit for event in captured)
    assert any(not event.sightings for event in captured)


def test_without_that_only_wanted_defects_stop_the_flight() -> None:
    _, every = flown(busy_street(), every_capture=True)
    flight, some = flown(busy_street())
    showing = [values(event) for event in every if isinstance(event, Occluded) or event.sightings]
    assert list(map(values, some)) == showing
    assert 0 < len(showing) < len(every)
    assert len(flight.captures()["t_s"]) > sum(isinstance(event, Captured) for event in some)


def test_a_capture_has_the_velocity_over_the_ground() -> None:
    scene = Scene(straight((30, 0)), (parked(45, 2.5, CAR),))
    settings = scene.settings("visibility.interval_s=0.05")
    flight = new_flight(scene.environment(settings), scene.traffic().trace(), settings, every_capture=True)
    flight.climb_to(6.0)
    list(advanced(flight, None))
    flight.fly_to((5.0, 0.0))
    list(advanced(flight, None))
    flight.inspect(0, np.array([[5.0, 0.0], [25.0, 0.0], [55.0, 3.0]]))
    captured = [event for event in advanced(flight, None) if isinstance(event, Captured)]
    flight.revisit(0, 1.5)
    captured += [event for event in advanced(flight, None) if isinstance(event, Captured)]
    track = flight.track()
    at = np.stack([track["x_m"], track["y_m"]], axis=1)
    for event in captured:
        row = int(np.argmin(np.abs(track["t_s"] - event.time_s)))
        speed = float(np.hypot(*event.velocity_mps))
        assert speed == pytest.approx(track["speed_mps"][row], abs=1e-9)
        made = (at[row] - at[row - 1]) / 0.05
        assert np.hypot(*(made - event.velocity_mps)) <= 8.0 * 0.05 + 1e-6
    assert max(np.hypot(*event.velocity_mps) for event in captured) == pytest.approx(5.0)
    assert any(abs(event.velocity_mps[1]) > 0.3 for event in captured)
    assert captured[-1].velocity_mps == (0.0, 0.0)
