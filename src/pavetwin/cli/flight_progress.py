"""How much of a mission is flown, and how long the rest will take, with the traffic that is still to be recorded."""

import time
from collections.abc import Callable

from pavetwin.cli.console import Bar, Lines
from pavetwin.mission.events import MissionEvent, ProgressMade
from pavetwin.mission.replay import Replay, grown_s

AGENT_S = 2e-5
"""Real seconds that SUMO takes for a second of an agent."""


class FlightProgress:
    """An observer of a mission that moves a bar.

    What is left is estimated from three rates: flown seconds a share of the mission, and real seconds a flown second
    and a simulated one. Traffic is recorded in the steps of `grown_s`.
    """

    def __init__(
        self, tell: Bar | Lines, what: str, traffic: Replay, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._tell, self._what, self._traffic, self._clock = tell, what, traffic, clock
        self._share, self._flown_s = 0.0, 0.0
        self._first_pace = _pace_of(traffic)
        self._last = clock()
        self._flying_s = self._recording_s = self._simulated_s = 0.0
        self._extension: float | None = None
        """When the one in progress began."""
        self._extending_s = self._extended = 0.0
        """The seconds that it simulates, and the share of them that is done."""

    def __call__(self, event: MissionEvent) -> None:
        """Told everything that happens in the mission."""
        if not isinstance(event, ProgressMade):
            return
        now = self._clock()
        self._end_extension()
        self._flying_s += now - self._last
        self._last, self._share, self._flown_s = now, event.share, event.time_s
        self._tell(self._share, self._what, self.remaining_s(0.0, 0.0))

    def extended(self, share: float) -> None:
        """Told the share done of an extension of the recorded traffic."""
        now = self._clock()
        if share <= self._extended:
            self._end_extension()  # another one has begun
        if self._extension is None:
            self._extension = self._last
        self._last, self._extending_s, self._extended = now, self._traffic.extending_s, share
        begun_s = now - self._extension
        left_s = begun_s * (1 - share) / share if share > 0 else 0.0
        self._tell(self._share, f"{self._what}, recording more traffic", self.remaining_s(left_s, begun_s, share))

    def _end_extension(self) -> None:
        if self._extension is not None:
            self._recording_s += self._last - self._extension
            self._simulated_s += self._extending_s
        self._extension, self._extended = None, 0.0

    def remaining_s(self, extension_s: float, begun_s: float, share: float = 0.0) -> float | None:
        """Seconds to the end of the mission; None where nothing is known yet.

        Args:
            extension_s: that the extension in progress still takes.
            begun_s: that it has taken.
            share: of it that is done.
        """
        if not self._share or not self._flown_s:
            return None
        whole_s = self._flown_s / self._share
        left_s = self._flying_s * (1 - self._share) / self._share + extension_s
        known_s = self._traffic.recording.duration_s - self._traffic.start_s
        if self._extension is not None:
            known_s = grown_s(known_s)
        longest_s = known_s
        while longest_s < whole_s:
            longest_s = grown_s(longest_s)
        simulated_s = self._simulated_s + share * (self._extending_s if self._extension is not None else 0.0)
        pace = (self._recording_s + begun_s) / simulated_s if simulated_s > 0 else self._first_pace
        return left_s + (longest_s - known_s) * pace


def _pace_of(traffic: Replay) -> float:
    """Real seconds that a second of a recording takes: as it did just now, else as its agents take on one core."""
    if traffic.recorder is not None and traffic.recorder.pace is not None:
        return traffic.recorder.pace
    numbers = traffic.recording.tracks.numbers
    return AGENT_S * float((numbers.vehicles + numbers.pedestrians).mean())
