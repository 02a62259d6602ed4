"""Manual flight: a pilot's stick in place of plan and policy, over the same environment and traffic as missions.

```python
flight = ByHand(environment, traffic, settings, [], sensor=sensor.name, policy=PILOT)
while not flight.is_over:
    flight.step(Stick(ahead=1.0), sensor)
result = flight.result(seed)
```

The stick is read once per step. The same sticks give the same flight, so `fly_again` repeats a recorded one. The UAV
keeps to the mission's altitude and flight domain and to the limits of transit. It has one battery: when that is low,
or when the pilot lands, it comes to rest, flies home and lands by itself.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import count
from typing import Any, Final, Generic, TypeVar

import numpy as np
import shapely
from shapely import STRtree

from pavetwin._core import BatteryLow, Captured, Occluded, Paused, RecordingEnds
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import inspect_speed_mps
from pavetwin.mission.events import BatteryRanLow, MissionEvent, OcclusionStarted, SegmentFinished, SegmentStarted
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.mission import Event, Mission
from pavetwin.mission.result import MissionResult, result_of, spec_of
from pavetwin.mission.spec import HANDED_IN
from pavetwin.sensing import Outcome, Sensor
from pavetwin.twin import SegmentStatus

PILOT: Final = "by-hand"
"""The policy name of manual flights."""

STEP_S: Final = 0.1
"""Time between two readings of the stick."""

SUMS: Final = ("time_s", "energy", "wait_s", "distance_m", "occlusions", "duplicates", "false_alarms")
"""Metrics that add up over the visits to a segment."""


@dataclass(frozen=True, slots=True)
class Stick:
    """A pilot's input: shares of the speed and of the rate of turn, −1 … 1."""

    ahead: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    """Counter-clockwise."""
    is_fast: bool = False
    """Fly at the speed of transit instead of inspection."""
    lands: bool = False
    """Fly home and land; cannot be taken back."""


Input = TypeVar("Input")
"""A stick, or the pedals of a car."""


@dataclass(frozen=True, slots=True)
class InputChange(Generic[Input]):
    """A change of the input, which holds from `step` on."""

    step: int
    input: Input


def input_by_step(changes: Iterable[InputChange[Input]], rest: Input) -> Iterator[Input]:
    """The recorded input at each step, without end; `rest` before the first change."""
    given = {change.step: change.input for change in changes}
    held = rest
    for step in count():
        held = given.get(step, held)
        yield held


def changes_as_values(changes: Iterable[InputChange[Any]]) -> list[dict[str, Any]]:
    """Changes as plain values, without the fields of an input at rest."""
    values = []
    for each in changes:
        rest = asdict(type(each.input)())
        given = {name: value for name, value in asdict(each.input).items() if value != rest[name]}
        values.append({"step": each.step, **given})
    return values


def changes_of_values(values: Iterable[Mapping[str, Any]], kind: type[Input]) -> list[InputChange[Input]]:
    """Changes of an input from the values of `changes_as_values`."""
    return [InputChange(each["step"], kind(**{k: v for k, v in each.items() if k != "step"})) for each in values]


def surface_below(surfaces: STRtree, place: tuple[float, float], previous: int | None) -> int:
    """Index of the segment at a place; between segments the previous one, or at first the nearest."""
    here = shapely.Point(place)
    inside = sorted(surfaces.query(here, predicate="intersects").tolist())
    if previous is not None and (not inside or previous in inside):
        return previous
    return int(inside[0] if inside else surfaces.nearest(here))


@dataclass
class ByHand(Mission):
    """One manual flight. Its targets are the segments that were looked at, in the order of the first look."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.targets = []
        self.changes: list[InputChange[Stick]] = []
        self._stick, self._steps = Stick(), 0
        self._by_segment: dict[int, SegmentMetrics] = {}
        self._surfaces = STRtree([segment.polygon for segment in self.environment.world.segments])
        self._inspect_mps = inspect_speed_mps(self.settings)

    def step(self, stick: Stick, sensor: Sensor) -> list[MissionEvent]:
        """Fly on for `STEP_S`, or to the end, and return the events on the way.

        Raises:
            PaveTwinError: the battery ran empty, or the traffic cannot be recorded any further.
        """
        if self._stick.lands:
            stick = replace(stick, lands=True)
        if stick != self._stick or not self.changes:
            self.changes.append(InputChange(self._steps, stick))
        self._stick = stick

        def answer(event: Event) -> None:
            if isinstance(event, Captured):
                self.confirm(sensor.detect(self.frame(event)))

        self._steps += 1
        return self.advance_until(self._steps * STEP_S, answer)

    def coverage(self) -> dict[str, float]:
        """Share of the surface seen so far, by segment."""
        segments = self.environment.world.segments
        return {segments[target].id: self.flight.surface_coverage(target) for target in self.targets}

    @property
    def looked_at(self) -> str | None:
        """The segment that the camera looks at; None before the first and after the last."""
        return None if self._segment is None or self.is_over else self.environment.world.segments[self._segment].id

    def result(self, seed: int) -> MissionResult:
        """The result of the flight. It cannot be flown again as a mission, only from its `changes`.

        Args:
            seed: seed of the sensor.

        Raises:
            PaveTwinError: the flight is not over.
        """
        self.rows = [self._by_segment[target] for target in self.targets] if self.is_over else []
        spec = spec_of(self.environment, self.traffic, self.settings, self.targets, HANDED_IN, seed)
        return result_of(self, spec)

    def _fly(self) -> Iterator[Event | Paused]:
        yield from self._take_off()
        yield from self._steer()
        if self._segment is not None:
            self._leave(self._segment)
        for target in self.targets:
            self._emit(SegmentFinished(self.flight.time_s, target))
        yield from self._go_home()

    def _steer(self) -> Iterator[Event | Paused]:
        """Follow the stick until the pilot lands or the battery is low, and the UAV has come to rest."""
        is_over = False
        while True:
            is_over = is_over or self._stick.lands
            self._command(Stick() if is_over else self._stick)
            match event := self.flight.advance(self._until_s):
                case Paused():
                    yield event
                case RecordingEnds():
                    self._extend()
                case BatteryLow():
                    is_over = True
                    self._emit(BatteryRanLow(self.flight.time_s, self.flight.position))
                case Occluded(since_s=since_s, visibility=visibility):
                    if since_s == event.time_s and self._segment is not None:
                        self._emit(OcclusionStarted(event.time_s, self._segment, visibility))
                case Captured():
                    yield event
                case other:
                    raise PaveTwinError(f"{type(other).__name__} is unexpected in a manual flight; please report it.")
            if is_over and self.flight.speed_mps == 0.0:
                return

    def _command(self, stick: Stick) -> None:
        target = surface_below(self._surfaces, self.flight.position, self._segment)
        if target != self._segment:
            if self._segment is not None:
                self._leave(self._segment)
            self._segment = target
            if target not in self.targets:
                self.targets = [*self.targets, target]
                self._emit(SegmentStarted(self.flight.time_s, target))
        uav = self.settings.uav
        speed_mps = uav.transit_speed_mps if stick.is_fast else self._inspect_mps
        self.flight.steer(
            target,
            ahead_mps=stick.ahead * speed_mps,
            left_mps=stick.left * speed_mps,
            turn_rad_s=stick.turn * float(np.radians(uav.yaw_rate_deg_s)),
        )

    def _leave(self, target: int) -> None:
        """Close a visit to a segment and add it to the segment's row."""
        self._update_coverage(target)
        segment = self.environment.world.segments[target]
        before = self._by_segment.get(target)
        now = self._meter.close(
            len(self._by_segment) if before is None else before.order,
            target,
            self.flight,
            self.memory,
            0,
            self.detections.outcomes,
            permanently_hidden=self.environment.permanently_hidden(target, self.settings),
            inspected=self.memory.status_of(segment.id) is SegmentStatus.INSPECTED,
            swaps=0,
        )
        self._by_segment[target] = now if before is None else self._added(before, now, target)

    def _added(self, before: SegmentMetrics, now: SegmentMetrics, target: int) -> SegmentMetrics:
        outcomes = Counter(self.detections.all.outcome[self.detections.all.segment == target])
        matched, wrong = outcomes[Outcome.CONFIRMED] + outcomes[Outcome.DUPLICATE], outcomes[Outcome.FALSE_ALARM]
        seen_m2 = now.surface_coverage * now.area_m2
        sums: dict[str, Any] = {name: getattr(before, name) + getattr(now, name) for name in SUMS}
        return replace(
            now,
            **sums,
            start_s=before.start_s,
            precision=matched / (matched + wrong) if matched + wrong else None,
            false_alarms_per_100_m2=100 * wrong / seen_m2 if seen_m2 else None,
        )


def fly_again(flight: ByHand, changes: Iterable[InputChange[Stick]], sensor: Sensor) -> None:
    """Repeat a recorded manual flight to its end.

    Args:
        flight: a new flight over the same inputs.
        changes: the recorded changes, in the order of time; the last one lands, or the battery ends the flight.

    Raises:
        PaveTwinError: as `ByHand.step`.
    """
    sticks = input_by_step(changes, Stick())
    while not flight.is_over:
        flight.step(next(sticks), sensor)
