"""Flying a mission from take-off to landing."""

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from pavetwin._core import Captured, Occluded
from pavetwin.arrays import UInt8Array
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.events import MissionEvent, MissionObserver, ProgressMade, SegmentFinished
from pavetwin.mission.inputs import MissionInputs, load_inputs
from pavetwin.mission.inspected_defects import DefectWatch
from pavetwin.mission.mission import Mission, Traffic
from pavetwin.mission.result import MissionResult, result_of, spec_of
from pavetwin.mission.spec import HANDED_IN, MissionSpec, PolicyInput
from pavetwin.policies import Policy, load_policy
from pavetwin.sensing import Detections, Frame, ImageSource, Sensor, load_sensor


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

    A sensor that looks after landing (`Sensor.after_landing`) is given all captures at the end. The policy then knows
    of no confirmed defect, and the observer receives `DefectsConfirmed` after landing, with the time of the capture.

    Args:
        inputs: the inputs that the spec names, where they are read already; see `load_inputs`.
        policy: a policy as a value, in place of the one that the spec names.
        sensor: a sensor as a value, in place of the one that the spec names; the spec keeps its name.
        image_source: renders the images of frames, for sensors that look at them.
        on_progress: called with the share flown, 0 … 1.
        on_look: called with the share done of the images that a sensor looks at after landing.
        observer: called with every event, see `pavetwin.mission.events`.
        watches_defects: compute in flight what `MissionResult.inspected_defects` needs of the traffic; otherwise the
            traffic is read again for it.

    Raises:
        PaveTwinError: an input is missing or has changed, the policy or the sensor is unknown, or the mission cannot be
            flown.
    """
    if policy is not None:
        spec = spec.model_copy(update={"policy": PolicyInput(name=HANDED_IN)})
    elif spec.policy.name == HANDED_IN:
        raise PaveTwinError("The mission's policy was handed in as a value; give it as `policy` again.")
    pilot = policy or load_policy(spec.policy.name, spec.settings.policy)
    looking = sensor or load_sensor(spec.settings.sensing, spec.seed)
    loaded = inputs or load_inputs(spec)
    loaded.check(spec)
    images = None if image_source is None else _CountedImages(image_source)
    watch = DefectWatch(loaded.environment, spec.settings)

    def observe(event: MissionEvent) -> None:
        if watches_defects and isinstance(event, SegmentFinished):
            trace = loaded.traffic.trace()
            watch.look_back(event.segment, mission.flight.captures(), mission.memory.confirmed, trace)
        if on_progress is not None and isinstance(event, ProgressMade):
            on_progress(event.share)
        if observer is not None:
            observer(event)

    mission = Mission(
        loaded.environment,
        loaded.traffic,
        spec.settings,
        loaded.indices(spec),
        policy=pilot.name,
        sensor=looking.name,
        other_classes=looking.other_classes,
        image_source=images,
        every_capture=looking.every_capture,
        sees_confirmed=looking.sees_confirmed,
        looked_px=looking.looked_px,
        observer=observe,
    )

    def detect(frame: Frame) -> Detections:
        try:
            return looking.detect(frame)
        except Exception as error:  # no context manager: this runs for every capture
            raise _named(error, "sensor", looking.name, frame.time_s) from error

    _answer(mission, pilot, None if looking.after_landing else detect)
    if looking.after_landing:
        frames = [replace(frame, sightings=()) for frame in mission.deferred_frames]
        with _failures_named("sensor", looking.name):
            looking.look_at(frames, on_look or (lambda _: None))
        mission.judge_deferred(detect)
    looked = images is not None and (images.taken > 0 or looking.looked_px is not None)
    return replace(result_of(mission, loaded.flown(spec, images=looked)), known_shares=watch.shares)


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
    """Fly one mission over an environment and traffic created in Python.

    Args:
        targets: indices of the segments to inspect, in order; see `choose_targets`.
        policy: a registered name, `path/to/file.py:ClassName`, or a policy.
        seed: seed of the sensor's random numbers.
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


class _CountedImages:
    """An image source that counts its images."""

    def __init__(self, source: ImageSource) -> None:
        self._source = source
        self.taken = 0

    def __call__(self, frame: Frame) -> UInt8Array:
        self.taken += 1
        return self._source(frame)


def _answer(mission: Mission, policy: Policy, detect: Callable[[Frame], Detections] | None) -> None:
    """Fly a mission to its end and answer every event.

    Args:
        detect: reports the detections of a frame; None defers every frame until after landing.
    """
    for event in mission:
        match event:
            case Captured():
                frame = mission.frame(event)
                if detect is None:
                    mission.defer()
                else:
                    mission.note(detect(frame))
            case Occluded():
                snapshot = mission.snapshot(event)
                with _failures_named("policy", policy.name, snapshot.time_s):
                    action = policy.decide(snapshot)
                mission.act(action)


@contextmanager
def _failures_named(what: str, name: str, time_s: float | None = None) -> Iterator[None]:
    """Report an error of a user's own code in one line."""
    try:
        yield
    except Exception as error:
        raise _named(error, what, name, time_s) from error


def _named(error: Exception, what: str, name: str, time_s: float | None) -> PaveTwinError:
    """An error of a user's own code as one line; a `PaveTwinError` unchanged."""
    if isinstance(error, PaveTwinError):
        return error
    where = traceback.extract_tb(error.__traceback__)[-1]
    when = "after landing" if time_s is None else f"{time_s:.1f} s into the mission"
    return PaveTwinError(
        f"The {what} '{name}' failed {when}: "
        f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})."
    )
