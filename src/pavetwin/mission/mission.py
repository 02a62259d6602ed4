"""The mission: a plan flown segment by segment, as a stream of events that policies and sensors answer."""

from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import atan2, inf
from typing import Protocol

import numpy as np
from shapely import LineString, Point

from pavetwin._core import (
    Arrived,
    BatteryLow,
    Captured,
    DisplacementPredictor,
    Flight,
    Occluded,
    Paused,
    RecordingEnds,
    Trace,
)
from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.detections import DetectionLog
from pavetwin.mission.environment import MissionEnvironment, new_flight, shutter_s, window_m
from pavetwin.mission.events import (
    ActionTaken,
    BatteryRanLow,
    BatterySwapped,
    DefectsConfirmed,
    MissionEvent,
    MissionObserver,
    NoteVisited,
    OcclusionStarted,
    ProgressMade,
    SegmentFinished,
    SegmentOutOfReach,
    SegmentStarted,
)
from pavetwin.mission.metrics import SegmentMeter, SegmentMetrics
from pavetwin.mission.track import MODES
from pavetwin.navigation.patterns import Pass, from_nearest_end, passes
from pavetwin.policies import Action, Displace, GoOn, Revisit, Wait
from pavetwin.sensing import Detections, Frame, ImageSource
from pavetwin.twin import (
    Agent,
    Confirmation,
    Episode,
    InspectionMemory,
    Note,
    Occlusion,
    Place,
    SegmentStatus,
    Snapshot,
    UavState,
)
from pavetwin.twin.state import agents_of
from pavetwin.uav import camera_of
from pavetwin.uav.wind import seen_velocity_mps


class KernelMoment:
    """The kernel's view of a moment, for what a snapshot computes on request. Immutable."""

    def __init__(self, predictor: DisplacementPredictor | None, time_s: float, trace: Trace) -> None:
        self._predictor = predictor
        self._time_s = time_s
        self._trace = trace

    def agents(self) -> tuple[Agent, ...]:
        return agents_of(self._trace.agents_at(self._time_s))

    def predict(self, displacements: Float64Array) -> Float64Array:
        if self._predictor is None:  # nothing is under inspection, so nothing is hidden
            return np.zeros(len(displacements))
        return self._predictor.predict(displacements)


Event = Captured | Occluded | BatteryLow
"""Events that stop a mission for an answer."""

LEAST_PROGRESS_M = 1.0
"""A mission that a full battery does not bring this much further is out of reach."""


class Traffic(Protocol):
    """The recorded traffic, which can be extended."""

    def trace(self) -> Trace: ...

    def extend(self, needed_s: float) -> Trace:
        """A recording that begins with the present one and reaches beyond `needed_s`."""
        ...


@dataclass(frozen=True, slots=True)
class _Deferred:
    """A frame that the sensor looks at after landing."""

    frame: Frame
    time_s: float
    segment: int
    on_revisit: bool
    rows: int
    """Number of segments closed before it."""
    events: int
    """Number of events before it."""


@dataclass
class Mission:
    """One UAV, one plan, one policy's name. Iterate over it, and answer every event:

    ```python
    for event in mission:
        match event:
            case Captured(): mission.confirm(sensor.detect(mission.frame(event)))
            case Occluded(): mission.act(policy.decide(mission.snapshot(event)))
    ```

    An event without an answer changes nothing. `advance_until` flies a part of the mission, and a loop that is left
    early can be entered again.
    """

    environment: MissionEnvironment
    traffic: Traffic
    settings: MissionSettings
    targets: Sequence[int]
    """Indices of the segments to inspect, in order."""
    policy: str = ""
    sensor: str = ""
    """Name of the sensor, for messages."""
    other_classes: Collection[str] = ()
    """Classes that the sensor reports and that are not defects, see `pavetwin.sensing.Sensor`."""
    image_source: ImageSource | None = None
    """Renders the images of frames, for sensors that look at them."""
    every_capture: bool = False
    """Captures that see no defect are events as well."""
    sees_confirmed: bool = False
    """Frames show confirmed defects as well."""
    looked_px: int | None = None
    """See `Sensor.looked_px`."""
    observer: MissionObserver = lambda _: None
    """Receives every event."""
    memory: InspectionMemory = field(default_factory=InspectionMemory)
    rows: list[SegmentMetrics] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.flight: Flight = new_flight(
            self.environment, self.traffic.trace(), self.settings, every_capture=self.every_capture
        )
        self.window_across_m, self.window_along_m = window_m(self.settings)
        self.swaps = 0
        self.events: list[MissionEvent] = []
        self.is_over = False
        """The UAV has landed after its last segment."""
        self.detections = DetectionLog(self.environment, sensor=self.sensor, other_classes=self.other_classes)
        self._meter = SegmentMeter(self.environment)
        self._camera, self._exposure_s = camera_of(self.settings), shutter_s(self.settings)
        self._sun_elevation_deg = self.environment.sun_elevation_deg(self.settings.conditions)
        self.sighted: list[tuple[int, int, float]] = []
        """Sightings of all frames: number of the capture, id of the defect, visible fraction."""
        self._frame: Frame | None = None
        self._deferred: list[_Deferred] = []
        self._attempts: dict[int, int] = {}
        self._tried: set[int] = set()
        self._left: Pass = np.empty((0, 2))
        self._segment: int | None = None
        self._on_revisit = False
        self._swapped_at_m = -1.0
        self._until_s = inf
        self._flying = self._fly()

    # Questions and answers during the flight.

    def snapshot(self, event: Occluded | None = None) -> Snapshot:
        """D_t now, with the visibility at an occlusion event if given."""
        occlusion = None
        if event is not None:
            episode = Episode(event.since_s, event.waited_s, event.displacements, event.since_displacement_m)
            occlusion = Occlusion(event.visibility, event.hidden_place, episode, event.permanently_hidden)
        if self._segment is not None:
            self._update_coverage(self._segment)
        segments = self.environment.world.segments
        return Snapshot(
            time_s=self.flight.time_s,
            segments=segments,
            uav=self.state(),
            memory=self.memory,
            policy=self.policy,
            segment=None if self._segment is None else segments[self._segment],
            occlusion=occlusion,
            window_along_m=self.window_along_m,
            moment=KernelMoment(self.flight.predictor(), self.flight.time_s, self.traffic.trace()),
            parked=self.environment.parked_agents,
        )

    def state(self) -> UavState:
        """x_t."""
        flight = self.flight
        return UavState(
            position=flight.position,
            altitude_m=flight.altitude_m,
            speed_mps=flight.speed_mps,
            battery=flight.battery,
            yaw_rad=flight.yaw_rad,
            mode=MODES[flight.mode],
        )

    @property
    def duration_s(self) -> float:
        """Time since take-off."""
        return self.flight.time_s

    @property
    def energy(self) -> float:
        """Energy used so far, in batteries, over all swaps."""
        return self.flight.energy_used

    @property
    def distance_m(self) -> float:
        """Distance flown so far, over the ground."""
        return self.flight.distance_m

    def act(self, action: Action) -> None:
        """Carry out a policy's action."""
        match action:
            case GoOn():
                return
            case Wait(seconds):
                self.flight.wait(seconds)
            case Displace(east_m, north_m, stay_s):
                self.flight.displace(east_m, north_m, stay_s)
            case Revisit(place, stay_s):
                self.memory = self.memory.note(Note(place, self.flight.time_s, stay_s))
            case _:
                raise PaveTwinError(
                    f"The policy '{self.policy}' answered {action!r}; it must be GoOn, Wait, Displace or Revisit."
                )
        self._emit(ActionTaken(self.flight.time_s, self.flight.position, action))

    def frame(self, event: Captured) -> Frame:
        """The frame of a capture for the sensor; each sighting in it is an attempt."""
        sightings, number = [], event.number
        for defect, fraction in event.sightings:
            attempt = self._attempts.get(defect, 0)
            self._attempts[defect] = attempt + 1
            sightings.append(self.environment.sighting(defect, fraction, attempt))
            self.sighted.append((number, defect, fraction))
            if self.settings.sensing.attempts == "first_capture":
                self.flight.set_wanted(defect, False)
                self._tried.add(defect)
        self._frame = Frame(
            number=number,
            time_s=event.time_s,
            position=event.position,
            altitude_m=event.altitude_m,
            yaw_rad=event.yaw_rad,
            camera=self._camera,
            conditions=self.settings.conditions,
            velocity_mps=seen_velocity_mps(self.settings, event.velocity_mps, event.time_s),
            exposure_s=self._exposure_s,
            sun_elevation_deg=self._sun_elevation_deg,
            sightings=tuple(sightings),
            source=self.image_source,
        )
        return self._frame

    def confirm(self, detections: Detections) -> Detections:
        """`note` the detections of the last frame, and return them with their outcomes."""
        self.note(detections)
        return self.detections.latest() if len(detections) else detections

    def note(self, detections: Detections) -> None:
        """Judge the detections of the last frame, and remember the defects that they confirm.

        Raises:
            PaveTwinError: no frame was requested.
        """
        if self._frame is None or self._segment is None:
            raise PaveTwinError("Detections belong to a frame: call mission.frame(event) before mission.confirm(…).")
        confirmed = self.detections.judge(
            self._frame, detections, self.memory.confirmed, segment=self._segment, on_revisit=self._on_revisit
        )
        if confirmed:
            self.memory = self.memory.confirm(confirmed, Confirmation(self.flight.time_s, self._on_revisit))
            if not self.sees_confirmed:
                for defect in confirmed:
                    self.flight.set_wanted(defect, False)
            self._emit(DefectsConfirmed(self.flight.time_s, tuple(confirmed), self._on_revisit))

    def defer(self) -> None:
        """Keep the last frame for `judge_deferred`, in place of `note`.

        Raises:
            PaveTwinError: no frame was requested.
        """
        if self._frame is None or self._segment is None:
            raise PaveTwinError("Call mission.frame(event) before mission.defer().")
        self._deferred.append(
            _Deferred(
                self._frame, self.flight.time_s, self._segment, self._on_revisit, len(self.rows), len(self.events)
            )
        )

    @property
    def deferred_frames(self) -> list[Frame]:
        """The frames kept by `defer`, in the order of time."""
        return [each.frame for each in self._deferred]

    def judge_deferred(self, detect: Callable[[Frame], Detections]) -> None:
        """Judge after landing what a sensor reports of the deferred frames, with the same outcome as in flight.

        The confirmed defects go into `memory` and `rows`, and each `DefectsConfirmed` to its place in `events`.
        """
        late: list[tuple[int, DefectsConfirmed]] = []
        rows, waiting = self.rows, deque(self._deferred)
        self.rows, self.sighted = [], []
        for number, row in enumerate(rows):
            while waiting and waiting[0].rows == number:
                deferred = waiting.popleft()
                if (event := self._judge_late(deferred, detect)) is not None:
                    late.append((deferred.events, event))
            self.rows.append(self._meter.with_detections(row, self.memory, self.detections.outcomes))
        for number, event in reversed(late):
            self.events.insert(number, event)
        for _, event in late:
            self.observer(event)

    def _judge_late(self, deferred: _Deferred, detect: Callable[[Frame], Detections]) -> DefectsConfirmed | None:
        frame, known = deferred.frame, self.memory.confirmed
        if not self.sees_confirmed or self.settings.sensing.attempts == "first_capture":  # as in `note` and `frame`
            frame = replace(frame, sightings=tuple(each for each in frame.sightings if each.defect.id not in known))
        if not frame.sightings and not self.every_capture:
            return None
        self.sighted += [(frame.number, each.defect.id, each.visible_fraction) for each in frame.sightings]
        confirmed = self.detections.judge(
            frame, detect(frame), known, segment=deferred.segment, on_revisit=deferred.on_revisit
        )
        if not confirmed:
            return None
        self.memory = self.memory.confirm(confirmed, Confirmation(deferred.time_s, deferred.on_revisit))
        return DefectsConfirmed(deferred.time_s, tuple(confirmed), deferred.on_revisit)

    def __iter__(self) -> Iterator[Event]:
        """Fly to the end, from event to event."""
        return self._events_until(inf)

    def advance_until(self, time_s: float, answer: Callable[[Event], object] = lambda _: None) -> list[MissionEvent]:
        """Fly to the first time step at or after a moment, or to the end, and return the events on the way.

        A mission flown in parts gives the same results.

        Args:
            answer: called with every event, to answer it with `confirm` or `act`.
        """
        known = len(self.events)
        for event in self._events_until(time_s):
            answer(event)
        return self.events[known:]

    def _events_until(self, time_s: float) -> Iterator[Event]:
        self._until_s = time_s
        for event in self._flying:
            if isinstance(event, Paused):
                return
            yield event
        self.is_over = True

    # The plan.

    def _fly(self) -> Iterator[Event | Paused]:
        yield from self._take_off()
        for done, target in enumerate(self.targets):
            yield from self._inspect_segment(target, done)
            self._emit(ProgressMade(self.flight.time_s, (done + 1) / len(self.targets)))
        yield from self._go_home()

    def _emit(self, event: MissionEvent) -> None:
        self.events.append(event)
        self.observer(event)

    def _inspect_segment(self, target: int, done: int) -> Iterator[Event | Paused]:
        segment = self.environment.world.segments[target]
        if not self.environment.reachable(target):
            raise PaveTwinError(
                f"No way leads from the base to segment '{segment.id}' at {self.environment.altitude_m:g} m; "
                "choose another altitude or segment."
            )
        self._segment = target
        self._emit(SegmentStarted(self.flight.time_s, target))
        revisits = 0
        plan = from_nearest_end(passes(segment, self.window_across_m, self.settings.pattern), self.flight.position)
        for number, line in enumerate(plan):
            yield from self._fly_pass(target, line)
            self._emit(ProgressMade(self.flight.time_s, (done + (number + 1) / (len(plan) + 1)) / len(self.targets)))
            revisits += len(self.memory.notes)
            yield from self._revisit_notes(target, line)
        self._update_coverage(target)
        self._segment = None
        inspected = self.memory.status_of(segment.id) is SegmentStatus.INSPECTED
        self.rows.append(
            self._meter.close(
                len(self.rows),
                target,
                self.flight,
                self.memory,
                revisits,
                self.detections.outcomes,
                permanently_hidden=self.environment.permanently_hidden(target, self.settings),
                inspected=inspected,
                swaps=self.swaps,
            )
        )
        self._emit(SegmentFinished(self.flight.time_s, target))

    def _fly_pass(self, target: int, line: Pass) -> Iterator[Event | Paused]:
        """Fly a pass with as many batteries as needed; each one after the first is full and must make progress."""
        left, is_full = line, False
        while not (yield from self._fly_line(target, left)):
            rest = self._left if len(self._left) > 1 else left
            if _length_m(rest) <= self.settings.uav.stopping_distance_m:
                return
            if is_full and _length_m(rest) > _length_m(left) - LEAST_PROGRESS_M:
                raise self._too_far(target)
            left, is_full = rest, True

    def _fly_line(self, target: int, line: Pass) -> Generator[Event | Paused, None, bool]:
        """Fly to a line, turn and inspect along it; False if a battery was swapped before its end."""
        return (
            (yield from self._carry_out(lambda: self.flight.fly_to(_place(line[0]))))
            and (yield from self._carry_out(lambda: self.flight.turn_to(_yaw(line))))
            and (yield from self._carry_out(lambda: self.flight.inspect(target, line)))
        )

    def _revisit_notes(self, target: int, line: Pass) -> Iterator[Event | Paused]:
        """Visit the places noted on this pass, in path order, each with a new attempt at defects tried before."""
        route = LineString(line)
        notes = sorted(self.memory.notes, key=lambda note: route.project(Point(note.place)))
        self.memory = self.memory.forget_notes()
        for note in notes:
            again = self._tried - set(self.memory.confirmed)
            for defect in again:
                self.flight.set_wanted(defect, True)
            self._on_revisit = True
            self._emit(NoteVisited(self.flight.time_s, note))
            yield from self._visit(target, note)
            self._on_revisit = False
            for defect in again:
                self.flight.set_wanted(defect, False)

    def _visit(self, target: int, note: Note) -> Iterator[Event | Paused]:
        """Stay over a noted place, with a second, full battery if the first is low."""
        if (yield from self._stay_over(target, note)) or (yield from self._stay_over(target, note)):
            return
        raise self._too_far(target)

    def _stay_over(self, target: int, note: Note) -> Generator[Event | Paused, None, bool]:
        return (yield from self._carry_out(lambda: self.flight.fly_to(note.place, revisit=True, stop_short=True))) and (
            yield from self._carry_out(lambda: self.flight.revisit(target, note.stay_s))
        )

    def _carry_out(self, command: Callable[[], None]) -> Generator[Event | Paused, None, bool]:
        """Fly until the command is carried out; False if a battery was swapped instead, and the UAV is over its base.

        `_left` then holds the rest of the line under inspection. The recording is extended on the way.
        """
        command()
        while True:
            match event := self.flight.advance(self._until_s):
                case Arrived():
                    return True
                case RecordingEnds():
                    self._extend()
                case BatteryLow():
                    self._left = self.flight.remaining()
                    self._emit(BatteryRanLow(self.flight.time_s, self.flight.position))
                    yield event
                    yield from self._swap_battery()
                    return False
                case Occluded(since_s=since_s, visibility=visibility) if since_s == event.time_s:
                    assert self._segment is not None
                    self._emit(OcclusionStarted(event.time_s, self._segment, visibility))
                    yield event
                case _:
                    yield event

    def _extend(self) -> None:
        longer = self.traffic.extend(self.flight.time_s)
        if longer.duration_s <= self.flight.time_s + self.settings.time_step_s:
            raise PaveTwinError(f"The traffic ends after {longer.duration_s:g} s and cannot be extended.")
        self.flight.extend(longer)

    def _too_far(self, target: int) -> PaveTwinError:
        self._emit(SegmentOutOfReach(self.flight.time_s, target))
        return PaveTwinError(
            f"One battery is too small to inspect '{self.environment.world.segments[target].id}' and to come back"
            f"{self._against_wind()}; lower energy.reserve or policy.max_wait_s, raise the capacity, fly another "
            "aircraft, or choose a segment nearer to the base."
        )

    def _against_wind(self) -> str:
        wind_mps = self.settings.conditions.wind_mps
        return f" in a wind of {wind_mps:g} m/s" if wind_mps else ""

    def _swap_battery(self) -> Iterator[Event | Paused]:
        if self.flight.distance_m - self._swapped_at_m < LEAST_PROGRESS_M:
            if self._segment is not None:
                self._emit(SegmentOutOfReach(self.flight.time_s, self._segment))
            raise PaveTwinError(
                f"One battery is too small to get anywhere and back{self._against_wind()}; lower energy.reserve, raise "
                "the capacity, or fly another aircraft."
            )
        yield from self._go_home()
        yield from self._carry_out(lambda: self.flight.swap_battery(self.settings.energy.swap_s))
        self.swaps += 1
        self._swapped_at_m = self.flight.distance_m
        self._emit(BatterySwapped(self.flight.time_s))
        yield from self._take_off()

    def _take_off(self) -> Iterator[Event | Paused]:
        yield from self._carry_out(lambda: self.flight.climb_to(self.settings.altitude_m))

    def _go_home(self) -> Iterator[Event | Paused]:
        yield from self._carry_out(self.flight.fly_home)
        yield from self._carry_out(lambda: self.flight.climb_to(0.0))

    def _update_coverage(self, target: int) -> None:
        coverage = self.flight.surface_coverage(target)
        name = self.environment.world.segments[target].id
        hidden = self.environment.permanently_hidden(target, self.settings)
        self.memory = self.memory.cover(name, coverage, self.settings.visibility.inspected_share, hidden)


def _place(point: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Place:
    return float(point[0]), float(point[1])


def _length_m(line: Pass) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _yaw(line: Pass) -> float:
    """Initial direction of a line."""
    steps = np.diff(line, axis=0)
    first = steps[np.flatnonzero(np.hypot(*steps.T) > 1e-6)[0]]
    return atan2(float(first[1]), float(first[0]))
