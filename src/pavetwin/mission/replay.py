"""Replay of recorded traffic in missions: extended if a mission outlasts it, never wrapped."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from pavetwin._core import Trace
from pavetwin.errors import PaveTwinError
from pavetwin.mission.airspace import Aircraft, with_aircraft
from pavetwin.mission.spec import TrafficInput
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.demand import Density
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_arguments
from pavetwin.world.model import World

FIRST_DURATION_S = 1200.0
"""Longest recording before the first flight; some ten segments fit."""

FIRST_PER_TARGET_S = 150.0
"""Recorded per segment of a mission of few segments; half of the missions over the demo's town need 90."""

HELD_ONCE = 1 << 19
"""Poses kept in memory in addition to those in use if a single mission is flown, which does not go back in time."""

GROWTH, GROWTH_S = 1.04, 15.0
"""Factor and least time by which a recording that is too short is extended. SUMO resumes where it stopped: smaller
steps would pack and read its end too often, larger ones would simulate too much in vain."""


def grown_s(known_s: float) -> float:
    """New length of a recording that is too short."""
    return max(known_s * GROWTH, known_s + GROWTH_S)


@dataclass
class Replay:
    """One recording, shared by all missions that are compared."""

    world: World
    recording: Recording
    routes: Sequence[str | Path] = ()
    aircraft: Sequence[Aircraft] = ()
    """Other aircraft, which the UAV keeps clear of at its own altitude."""
    file: Path | None = None
    """The recording's file, if it was given in place of density or routes."""
    start_s: float = 0.0
    """Time of take-off in the recording."""
    instead_of: str | None = None
    """The traffic that this one replaces, since the world cannot reach it."""
    flies_once: bool = False
    """A single mission is flown, so that passed traffic need not stay in memory."""
    on_extend: Callable[[float], None] = lambda _: None
    """Receives the share done of an extension."""
    extending_s: float = field(default=0.0, init=False)
    """Seconds that SUMO simulates for the latest extension."""
    recorder: Recorder | None = field(default=None, repr=False)
    """Extends the recording; created when it is first needed."""
    _trace: Trace | None = field(default=None, init=False, repr=False)
    _entered: bool = field(default=False, init=False, repr=False)

    @property
    def area(self) -> TrafficArea | None:
        """The streets with traffic; None for the whole town."""
        return self.recording.origin.area

    def source(self) -> TrafficInput:
        """The source of the traffic for a mission's spec."""
        origin = self.recording.origin
        return TrafficInput.of(
            origin.asked,
            origin.seed,
            routes=self.routes,
            recording=self.file,
            take_off_s=self.start_s,
            instead_of=self.instead_of,
        )

    def taking_off_at(self, start_s: float) -> Self:
        """The same replay, with take-off at a moment of the recording.

        Raises:
            PaveTwinError: the recording ends before it, or a user's own demand has ended by then.
        """
        if self.recording.duration_s <= start_s:
            raise PaveTwinError(
                f"`take_off_s` {start_s:g}: the recording ends after {self.recording.duration_s:g} s; take off earlier."
            )
        if self.recording.origin.asked is None and self.recording.after(start_s).is_empty:
            raise PaveTwinError(
                f"`take_off_s` {start_s:g}: nothing moves from then on, the demand has ended; take off earlier."
            )
        self.start_s = start_s
        return self

    def recorded_s(self, time_s: float) -> float:
        """Time in the recording of a moment of the mission; take-off is at a step of the recording."""
        return round(self.start_s / self.recording.step_s) * self.recording.step_s + time_s

    def trace(self) -> Trace:
        if self._trace is None:
            self._trace = self._traced(known=None)
        return self._trace

    def _traced(self, known: Trace | None) -> Trace:
        """Trace of the recording from take-off on, aircraft first; `known` is the trace of its beginning."""
        ground = trace_arguments(self.recording.after(self.start_s))
        held_rows = HELD_ONCE if self.flies_once else None
        return Trace.of_parts(**with_aircraft(ground, self.aircraft), known=known, held_rows=held_rows)

    def extend(self, needed_s: float) -> Trace:
        """A trace that begins with the present one and lasts beyond `needed_s`.

        Raises:
            PaveTwinError: the traffic cannot be recorded again with the same beginning.
        """
        if self.recording.duration_s - self.start_s <= needed_s + self.recording.step_s:
            longer_s = grown_s(max(self.recording.duration_s, self.start_s + needed_s))
            if self.recorder is None:
                self.recorder = Recorder.of(self.recording, self.world, self.routes, unchanged=self.file)
                if self._entered:
                    self.recorder.__enter__()
            self.extending_s = self.recorder.simulated_s(longer_s)
            self.recording = self.recorder.beyond(longer_s, self.on_extend)
            self._trace = self._traced(self._trace)
        return self.trace()

    def __enter__(self) -> Self:
        self._entered = True
        if self.recorder is not None:
            self.recorder.__enter__()
        return self

    def __exit__(self, *raised: Any) -> None:
        self._entered = False
        if self.recorder is not None:
            self.recorder.__exit__(*raised)


def replay_of(
    world: World,
    density: Density | str | None,
    seed: int,
    *,
    routes: Sequence[str | Path] = (),
    take_off_s: float = 0.0,
    area: TrafficArea | None = None,
    first_s: float = FIRST_DURATION_S,
    on_progress: Callable[[float], None] | None = None,
    on_search: Callable[[float], None] | None = None,
) -> Replay:
    """The traffic of a world at a density, recorded by SUMO now if it was not before.

    SUMO keeps running, so that the recording can be extended, until the replay's `with` block or its life ends.

    Args:
        area: the streets with traffic; None for the whole town.
        first_s: time recorded from take-off on; longer missions extend it.
        on_progress: called with the share recorded.
        on_search: called with the share done of the search for the demand of a level of service or an hour.

    Raises:
        PaveTwinError: as `pavetwin.traffic.record.record`.
    """
    recorder = Recorder(Inputs.of(world, density, seed, routes, area))
    recording = recorder.until(take_off_s + first_s, on_progress, on_search)
    return Replay(world, recording, routes, recorder=recorder)
