"""Flying a mission from take-off to landing, and what it leaves behind."""

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from pavetwin._core import Captured, Occluded, Trace
from pavetwin.arrays import UInt8Array
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.defect_watch import DefectWatch
from pavetwin.mission.detections import DetectionLog
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.events import (
    ActionTaken,
    BatteryRanLow,
    MissionEvent,
    MissionObserver,
    ProgressMade,
    SegmentFinished,
)
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.mission import Mission, Traffic
from pavetwin.mission.replay import Replay
from pavetwin.mission.spec import (
    HANDED_IN,
    AircraftTrack,
    DefectInput,
    MissionSpec,
    PolicyInput,
    TrafficInput,
    WorldInput,
)
from pavetwin.policies import Policy, load_policy
from pavetwin.sensing import Detection, Frame, ImageSource, JudgedDetection, Outcome, Sensor, load_sensor
from pavetwin.traffic.flow import Flow, flow_of
from pavetwin.traffic.recording import Recording
from pavetwin.twin import InspectionMemory

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, DefectShares, TrackColumns
    from pavetwin.mission.inspected_defects import InspectedDefect


@dataclass(frozen=True)
class Decision:
    """Where a policy did something other than going on, or a battery was swapped."""

    time_s: float
    position: tuple[float, float]
    action: str
    """`wait`, `displace`, `revisit` or `battery`."""


@dataclass(frozen=True)
class MissionResult:
    """A mission that was flown to its end."""

    spec: MissionSpec
    environment: MissionEnvironment
    policy: str
    """What the policy calls itself."""
    sensor: str
    rows: tuple[SegmentMetrics, ...]
    log: DetectionLog = field(repr=False)
    """What the sensor reported."""
    memory: InspectionMemory
    track: "TrackColumns"
    captures: "CaptureColumns"
    swept: frozenset[int]
    """Defects, by their id, whose centre the inspection window passed over."""
    sighted: tuple[tuple[int, int, float], ...]
    """Of the frames that the sensor was shown: capture, id of a defect that it sees, visible fraction of that."""
    looked_px: int | None
    """See `Sensor.looked_px`."""
    trace: Trace
    """The recorded traffic that it was flown against, from take-off on."""
    duration_s: float
    energy: float
    """In batteries, over all swaps."""
    distance_m: float
    swaps: int
    events: tuple[MissionEvent, ...]
    """Everything that happened, in the order of time."""
    recording: Recording | None = None
    """The recorded traffic; None where it was handed in as a value."""
    known_shares: Mapping[tuple[int, int], "DefectShares"] = field(default_factory=dict, repr=False)
    """What hid a defect in a capture, by their numbers, as far as it was worked out in flight."""

    @cached_property
    def detections(self) -> tuple[JudgedDetection, ...]:
        """All that the sensor reported, in the order of time."""
        return tuple(self.log.all)

    @cached_property
    def flow(self) -> Flow | None:
        """How the recorded traffic flows."""
        return None if self.recording is None else flow_of(self.recording)

    @cached_property
    def inspected_defects(self) -> tuple["InspectedDefect", ...]:
        """Every defect of the inspected segments: found, or missed and why. Judged once: it is slow."""
        from pavetwin.mission.inspected_defects import inspected_defects

        return inspected_defects(self)

    @property
    def settings(self) -> MissionSettings:
        return self.spec.settings

    @property
    def seed(self) -> int:
        """Of the sensor."""
        return self.spec.seed

    @property
    def traffic(self) -> str:
        """Name of the recording, such as `high-1`; empty where the traffic was handed in as a value."""
        return "" if self.spec.traffic.density == HANDED_IN else self.spec.traffic.name

    @cached_property
    def confirmed(self) -> tuple[JudgedDetection, ...]:
        """The detections that confirmed a defect, one for each confirmed defect."""
        return tuple(each for each in self.detections if each.outcome is Outcome.CONFIRMED)

    @cached_property
    def actions(self) -> tuple[Decision, ...]:
        """Where the policy acted, and where the UAV turned back for another battery."""
        found = []
        for event in self.events:
            match event:
                case ActionTaken():
                    found.append(Decision(event.time_s, event.position, type(event.action).__name__.lower()))
                case BatteryRanLow():
                    found.append(Decision(event.time_s, event.position, "battery"))
        return tuple(found)


def fly(
    spec: MissionSpec,
    *,
    inputs: MissionInputs | None = None,
    policy: Policy | None = None,
    sensor: Sensor | None = None,
    image_source: ImageSource | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_look: Callable[[float], None] | None = None,
    observer: MissionObserver | None = None,
    watches_defects: bool = False,
) -> MissionResult:
    """Fly one mission.

    Where its sensor looks after landing, the mission is flown twice by the same spec: for its captures, and again with
    what the sensor found in them. Policies know nothing of it in either flight, so that both are the same.

    Args:
        inputs: what the spec names, where it is read already; see `load_inputs`.
        policy: a policy as a value, in place of the one that the spec names.
        sensor: a sensor as a value, in place of the one that the spec names, and goes on naming.
        image_source: takes the images of frames, for sensors that look at them.
        on_progress: told the share done, 0 … 1.
        on_look: told the share done of what a sensor looks at after landing.
        observer: told everything that happens, see `pavetwin.mission.events`.
        watches_defects: work out in flight what `MissionResult.inspected_defects` needs of the traffic, which is read
            again for it otherwise.

    Raises:
        PaveTwinError: an input is gone or has changed, the policy or the sensor is not known, or the mission cannot be
            flown.
    """
    if policy is not None:
        spec = spec.model_copy(update={"policy": PolicyInput(name=HANDED_IN)})
    elif spec.policy.name == HANDED_IN:
        raise PaveTwinError("The mission's policy was handed in as a value; give it as `policy` again.")
    spec = spec.with_models()
    chosen = policy or load_policy(spec.policy.name, spec.settings.policy)
    looking = sensor or load_sensor(spec.settings.sensing, spec.seed)
    loaded = inputs or load_inputs(spec)
    loaded.check(spec)
    spec = loaded.flown(spec)
    images = None if image_source is None else _CountedImages(image_source)

    watch = DefectWatch(loaded.environment, spec.settings)

    def tell(event: MissionEvent) -> None:
        if watches_defects and isinstance(event, SegmentFinished):
            trace = loaded.traffic.trace()
            watch.look_back(event.segment, flown.flight.captures(), flown.memory.confirmed, trace)
        if on_progress is not None and isinstance(event, ProgressMade):
            on_progress(event.share)
        if observer is not None:
            observer(event)

    def mission(observer: MissionObserver = lambda _: None) -> Mission:
        return Mission(
            loaded.environment,
            loaded.traffic,
            spec.settings,
            loaded.indices(spec),
            policy=chosen.name,
            sensor=looking.name,
            other_classes=looking.other_classes,
            image_source=images,
            every_capture=looking.every_capture,
            sees_confirmed=looking.sees_confirmed,
            looked_px=looking.looked_px,
            observer=observer,
        )

    if looking.after_landing:
        frames: list[Frame] = []

        def note(frame: Frame) -> Sequence[Detection]:
            frames.append(replace(frame, sightings=()))
            return ()

        _answer(mission(), deepcopy(chosen), note, is_told=False)
        with _failures_named("sensor", looking.name):
            looking.look_at(frames, on_look or (lambda _: None))
    flown = mission(tell)

    def detect(frame: Frame) -> Sequence[Detection]:
        try:
            return looking.detect(frame)
        except Exception as error:  # no context manager: this runs for every capture
            raise _named(error, "sensor", looking.name, frame.time_s) from error

    _answer(flown, chosen, detect, is_told=not looking.after_landing)
    defect_classes = {defect.kind for defect in loaded.environment.defects}
    looked = images is not None and (images.taken > 0 or looking.looked_px is not None)
    result = result_of(flown, spec.with_versions(images=looked, defect_classes=defect_classes))
    return replace(result, known_shares=watch.shares)


def result_of(mission: Mission, spec: MissionSpec | None = None) -> MissionResult:
    """What a mission leaves behind, for one whose events you answered yourself.

    Args:
        spec: that it was made from; unless given, one over values, which cannot be flown again from its description.

    Raises:
        PaveTwinError: the mission is not over.
    """
    if not mission.is_over:
        raise PaveTwinError("The mission is not over: iterate over it to its end before you ask for its result.")
    if spec is None:
        spec = spec_of(mission.environment, mission.traffic, mission.settings, mission.targets, HANDED_IN, seed=0)
    flight = mission.flight
    return MissionResult(
        spec=spec,
        environment=mission.environment,
        policy=mission.policy,
        sensor=mission.sensor,
        rows=tuple(mission.rows),
        log=mission.detections,
        memory=mission.memory,
        track=flight.track(),
        captures=flight.captures(),
        swept=frozenset(np.flatnonzero(flight.swept()).tolist()),
        sighted=tuple(mission.sighted),
        looked_px=mission.looked_px,
        trace=mission.traffic.trace(),
        duration_s=mission.duration_s,
        energy=mission.energy,
        distance_m=mission.distance_m,
        swaps=mission.swaps,
        events=tuple(mission.events),
        recording=mission.traffic.recording if isinstance(mission.traffic, Replay) else None,
    )


def fly_over(
    environment: MissionEnvironment,
    traffic: Traffic,
    settings: MissionSettings,
    targets: Sequence[int],
    policy: str | Policy = "hover",
    *,
    seed: int = 0,
    sensor: Sensor | None = None,
    image_source: ImageSource | None = None,
    on_progress: Callable[[float], None] | None = None,
    observer: MissionObserver | None = None,
) -> MissionResult:
    """Fly one mission over an environment and traffic that were made in Python.

    Args:
        targets: indices of the segments to inspect, in order; see `choose_targets`.
        policy: a registered name, `path/to/file.py:ClassName`, or a policy.
        seed: of the sensor's random numbers.
        sensor: a sensor as a value, in place of the one that the settings name.

    Raises:
        PaveTwinError: as `fly`.
    """
    spec = spec_of(environment, traffic, settings, targets, policy if isinstance(policy, str) else policy.name, seed)
    return fly(
        spec,
        inputs=MissionInputs(environment, traffic),
        policy=None if isinstance(policy, str) else policy,
        sensor=sensor,
        image_source=image_source,
        on_progress=on_progress,
        observer=observer,
    )


def spec_of(
    environment: MissionEnvironment,
    traffic: Traffic,
    settings: MissionSettings,
    targets: Sequence[int],
    policy: str,
    seed: int,
) -> MissionSpec:
    """The spec of a mission over values; what was never a file is named as handed in."""
    world = environment.world
    return MissionSpec.of(
        world=WorldInput.of(world),
        defects=DefectInput(content_hash=environment.defects_hash),
        traffic=traffic.source() if isinstance(traffic, Replay) else TrafficInput(density=HANDED_IN),
        aircraft=_tracks(traffic),
        base=(world.base.x, world.base.y),
        targets=tuple(world.segments[index].id for index in targets),
        policy=PolicyInput.of(policy),
        seed=seed,
        parking_seed=environment.parking.seed,
        parking_mix=environment.parking.mix,
        settings=settings,
    )


def _tracks(traffic: Traffic) -> tuple[AircraftTrack, ...] | None:
    """The tracks of other aircraft in traffic that is a value."""
    aircraft = traffic.aircraft if isinstance(traffic, Replay) else ()
    return tuple(AircraftTrack.of(each) for each in aircraft) or None


class _CountedImages:
    """An image source, and how many images it has taken."""

    def __init__(self, source: ImageSource) -> None:
        self._source = source
        self.taken = 0

    def __call__(self, frame: Frame) -> UInt8Array:
        self.taken += 1
        return self._source(frame)


def _answer(mission: Mission, policy: Policy, detect: Callable[[Frame], Sequence[Detection]], *, is_told: bool) -> None:
    """Fly a mission to its end and answer every event.

    Args:
        is_told: whether the policy knows in flight which defects are confirmed.
    """
    for event in mission:
        match event:
            case Captured():
                mission.note(detect(mission.frame(event)))
            case Occluded():
                snapshot = mission.snapshot(event)
                if not is_told:
                    snapshot = replace(snapshot, memory=replace(snapshot.memory, confirmed=MappingProxyType({})))
                with _failures_named("policy", policy.name, snapshot.time_s):
                    action = policy.decide(snapshot)
                mission.act(action)


@contextmanager
def _failures_named(what: str, name: str, time_s: float | None = None) -> Iterator[None]:
    """A user's own code may fail in a situation that its check did not think of."""
    try:
        yield
    except Exception as error:
        raise _named(error, what, name, time_s) from error


def _named(error: Exception, what: str, name: str, time_s: float | None) -> PaveTwinError:
    """An error of a user's own code in one line; our own as it is."""
    if isinstance(error, PaveTwinError):
        return error
    where = traceback.extract_tb(error.__traceback__)[-1]
    when = "after landing" if time_s is None else f"{time_s:.1f} s into the mission"
    return PaveTwinError(
        f"The {what} '{name}' failed {when}: "
        f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})."
    )
