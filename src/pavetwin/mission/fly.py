"""Flying a mission from take-off to landing, and what it leaves behind."""

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pavetwin._core import BatteryLow, Captured, Occluded
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.events import MissionEvent, MissionObserver, ProgressMade
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.mission import Mission, Traffic
from pavetwin.policies import Action, Policy, load_policy
from pavetwin.sensing import load_sensor
from pavetwin.twin import InspectionMemory, Snapshot

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, TrackColumns


@dataclass(frozen=True)
class Detection:
    """A defect that was confirmed, and the capture that did."""

    defect: int
    time_s: float
    on_revisit: bool
    attempt: int
    """1 for the first."""
    visible_fraction: float
    position: tuple[float, float]
    """Of the UAV."""
    yaw_rad: float


@dataclass(frozen=True)
class Place:
    """Where a policy did something other than going on."""

    time_s: float
    position: tuple[float, float]
    action: str


@dataclass(frozen=True)
class MissionResult:
    """A mission that was flown to its end."""

    environment: MissionEnvironment
    settings: MissionSettings
    policy: str
    sensor: str
    seed: int
    traffic: str
    """Name of the recording, such as `high-1`."""
    rows: tuple[SegmentMetrics, ...]
    detections: tuple[Detection, ...]
    actions: tuple[Place, ...]
    memory: InspectionMemory
    track: "TrackColumns"
    captures: "CaptureColumns"
    duration_s: float
    energy: float
    distance_m: float
    swaps: int
    events: tuple[MissionEvent, ...]
    """Everything that happened, in order."""


def fly(
    environment: MissionEnvironment,
    traffic: Traffic,
    settings: MissionSettings,
    targets: Sequence[int],
    policy: str | Policy = "hover",
    *,
    seed: int = 0,
    traffic_name: str = "",
    on_progress: Callable[[float], None] | None = None,
    observer: MissionObserver | None = None,
) -> MissionResult:
    """Fly one mission.

    Args:
        targets: indices of the segments to inspect, in order; see `choose_targets`.
        policy: a registered name, `path/to/file.py:ClassName`, or a policy.
        seed: of the sensor's random numbers.
        on_progress: told the share done, about.
        observer: told everything that happens, see `pavetwin.mission.events`.

    Raises:
        PaveTwinError: the policy or the sensor is not known, or the mission cannot be flown.
    """
    decides = load_policy(policy, settings.policy) if isinstance(policy, str) else policy
    sensor = load_sensor(settings.sensing, seed)

    def tell(event: MissionEvent) -> None:
        if on_progress is not None and isinstance(event, ProgressMade):
            on_progress(event.share)
        if observer is not None:
            observer(event)

    mission = Mission(environment, traffic, settings, targets, policy=decides.name, observer=tell)
    detections: list[Detection] = []
    actions: list[Place] = []
    for event in mission:
        match event:
            case Captured():
                frame = mission.frame(event)
                confirmed = sensor.detect(frame)
                mission.confirm(confirmed)
                sightings = {sighting.defect: sighting for sighting in frame.sightings}
                detections += [
                    Detection(
                        defect,
                        frame.time_s,
                        mission.memory.confirmed[defect].on_revisit,
                        sightings[defect].attempt + 1,
                        sightings[defect].visible_fraction,
                        frame.position,
                        frame.yaw_rad,
                    )
                    for defect in confirmed
                ]
            case Occluded():
                action = _decide(decides, mission.snapshot(event))
                mission.act(action)
                name = type(action).__name__.lower()
                if name != "goon":
                    actions.append(Place(event.time_s, mission.flight.position, name))
            case BatteryLow():
                actions.append(Place(mission.flight.time_s, mission.flight.position, "battery"))
    flight = mission.flight
    return MissionResult(
        environment=environment,
        settings=settings,
        policy=decides.name,
        sensor=sensor.name,
        seed=seed,
        traffic=traffic_name,
        rows=tuple(mission.rows),
        detections=tuple(detections),
        actions=tuple(actions),
        memory=mission.memory,
        track=flight.track(),
        captures=flight.captures(),
        duration_s=flight.time_s,
        energy=flight.energy_used,
        distance_m=flight.distance_m,
        swaps=mission.swaps,
        events=tuple(mission.events),
    )


def _decide(policy: Policy, snapshot: Snapshot) -> Action:
    """The policy's answer; a user's own may fail in a situation that its check did not think of."""
    try:
        return policy.decide(snapshot)
    except PaveTwinError:
        raise
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        raise PaveTwinError(
            f"The policy '{policy.name}' failed {snapshot.time_s:.1f} s into the mission: "
            f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})."
        ) from error
