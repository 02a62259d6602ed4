"""The time that a mission still takes is told with the traffic that it still records."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from pavetwin.cli.console import Bar
from pavetwin.cli.flight_report import FlightProgress
from pavetwin.mission.events import ProgressMade
from pavetwin.mission.replay import FIRST_DURATION_S, Replay, grown_s

FLYING, SIMULATING = 0.002, 0.02
"""Real seconds that a second takes."""


class Flight:
    """A mission whose segments take alike, and what its bar showed."""

    def __init__(self, recorded_s: float, segments: int = 50) -> None:
        self.now_s, self.segments = 0.0, segments
        self.shown: list[tuple[float, float, str, float | None]] = []
        """Real time, share, text and time left."""
        self.traffic = SimpleNamespace(
            recording=SimpleNamespace(duration_s=recorded_s),
            recorder=SimpleNamespace(pace=SIMULATING),
            start_s=0.0,
            extending_s=0.0,
        )
        self.progress = FlightProgress(
            cast("Bar", self.tell), "Flying", cast("Replay", self.traffic), clock=lambda: self.now_s
        )

    def tell(self, share: float, what: str, remaining_s: float | None) -> None:
        self.shown.append((self.now_s, share, what, remaining_s))

    def fly(self, lasts_s: float, *, from_the_beginning: bool = False) -> None:
        """Args: from_the_beginning: whether the first extension simulates what is known, too."""
        time_s = 0.0
        for done in range(1, self.segments + 1):
            then_s = lasts_s * done / self.segments
            while self.traffic.recording.duration_s < then_s:
                known_s: float = self.traffic.recording.duration_s
                self.traffic.extending_s = grown_s(known_s) - (0.0 if from_the_beginning else known_s)
                from_the_beginning = False
                for step in range(1, 21):
                    self.now_s += SIMULATING * self.traffic.extending_s / 20
                    self.progress.extended(step / 20)
                self.traffic.recording.duration_s = grown_s(known_s)
            self.now_s += FLYING * (then_s - time_s)
            time_s = then_s
            self.progress(ProgressMade(time_s, done / self.segments))


def test_the_time_left_is_right_within_a_third_from_the_first_pass_on() -> None:
    flight = Flight(FIRST_DURATION_S)
    flight.fly(8000.0)
    checked = 0
    for now_s, share, _, left_s in flight.shown:
        if (truth_s := flight.now_s - now_s) > 5.0:
            assert left_s == pytest.approx(truth_s, rel=1 / 3), share
            checked += 1
    assert checked > 50


def test_a_recording_from_the_disk_is_simulated_again_at_first() -> None:
    """What that takes is not known before it begins, and misleads nobody afterwards."""
    flight = Flight(FIRST_DURATION_S)
    flight.fly(8000.0, from_the_beginning=True)
    extended = next(number for number, (*_, what, _left) in enumerate(flight.shown) if "recording" in what)
    for now_s, share, _, left_s in flight.shown[extended:]:
        if (truth_s := flight.now_s - now_s) > 5.0:
            assert left_s == pytest.approx(truth_s, rel=1 / 3), share


def test_without_more_traffic_only_the_flight_is_left() -> None:
    flight = Flight(10_000.0)
    flight.fly(8000.0)
    lefts: list[Any] = [left for *_, left in flight.shown]
    assert lefts == pytest.approx([0.0 + 16.0 * (1 - done / 50) for done in range(1, 51)])


def test_the_share_is_that_of_the_mission_while_more_is_recorded() -> None:
    flight = Flight(FIRST_DURATION_S)
    flight.fly(2000.0)
    shares = [share for _, share, *_ in flight.shown]
    assert shares == sorted(shares)
    assert {what for _, _, what, _ in flight.shown} == {"Flying", "Flying, recording more traffic"}
