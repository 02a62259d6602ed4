"""The result of a mission: its specification, metrics, detections, track, captures and events."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pavetwin._core import Trace
from pavetwin.config import MissionSettings
from pavetwin.detections import Detections, Outcome
from pavetwin.errors import PaveTwinError
from pavetwin.mission.detections import DetectionLog
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.events import ActionTaken, BatteryRanLow, MissionEvent
from pavetwin.mission.inspected_defects import InspectedDefect, inspected_defects
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
from pavetwin.traffic.flow import Flow, flow_of
from pavetwin.traffic.recording import Recording
from pavetwin.twin import InspectionMemory

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, DefectShares, TrackColumns


@dataclass(frozen=True)
class Decision:
    """A place where a policy did something other than fly on, or a battery was swapped."""

    time_s: float
    position: tuple[float, float]
    action: str
    """`wait`, `displace`, `revisit` or `battery`."""


@dataclass(frozen=True)
class MissionResult:
    """Result of a mission flown to its end."""

    spec: MissionSpec
    environment: MissionEnvironment
    policy: str
    """Name of the policy."""
    sensor: str
    rows: tuple[SegmentMetrics, ...]
    log: DetectionLog = field(repr=False)
    """The judged detections."""
    memory: InspectionMemory
    track: "TrackColumns"
    captures: "CaptureColumns"
    swept: frozenset[int]
    """Ids of the defects whose centre the inspection window passed over."""
    sighted: tuple[tuple[int, int, float], ...]
    """Sightings in the sensor's frames: number of the capture, id of the defect, visible fraction."""
    looked_px: int | None
    """See `Sensor.looked_px`."""
    trace: Trace
    """The recorded traffic, from take-off on."""
    duration_s: float
    energy: float
    """Energy used, in batteries, over all swaps."""
    distance_m: float
    swaps: int
    events: tuple[MissionEvent, ...]
    """All events, in the order of time."""
    recording: Recording | None = None
    """The recording of the traffic; None if it was handed in as a value."""
    known_shares: Mapping[tuple[int, int], "DefectShares"] = field(default_factory=dict, repr=False)
    """Shares computed in flight, by id of the defect and number of the capture."""

    @cached_property
    def detections(self) -> Detections:
        """All detections, in the order of time."""
        return self.log.all

    @cached_property
    def flow(self) -> Flow | None:
        """Flow of the recorded traffic."""
        return None if self.recording is None else flow_of(self.recording)

    @cached_property
    def inspected_defects(self) -> tuple[InspectedDefect, ...]:
        """Every defect of the inspected segments: found, or missed and why. Computed once: it is slow."""
        return inspected_defects(self)

    @property
    def settings(self) -> MissionSettings:
        return self.spec.settings

    @property
    def seed(self) -> int:
        """Seed of the sensor."""
        return self.spec.seed

    @property
    def traffic(self) -> str:
        """Name of the recording, such as `high-1`; empty if the traffic was handed in as a value."""
        return "" if self.spec.traffic.density == HANDED_IN else self.spec.traffic.name

    @cached_property
    def confirmed(self) -> Detections:
        """The detections that confirmed a defect, one for each confirmed defect."""
        return self.detections[self.detections.outcome == Outcome.CONFIRMED]

    @cached_property
    def actions(self) -> tuple[Decision, ...]:
        """Places where the policy acted, and where the UAV turned back for another battery."""
        found = []
        for event in self.events:
            match event:
                case ActionTaken():
                    found.append(Decision(event.time_s, event.position, type(event.action).__name__.lower()))
                case BatteryRanLow():
                    found.append(Decision(event.time_s, event.position, "battery"))
        return tuple(found)


def result_of(mission: Mission, spec: MissionSpec | None = None) -> MissionResult:
    """The result of a mission whose events you answered yourself.

    Args:
        spec: the mission's spec; by default one over values, which cannot be flown again from its description.

    Raises:
        PaveTwinError: the mission is not over.
    """
    if not mission.is_over:
        raise PaveTwinError("The mission is not over: iterate over it to its end first.")
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


def spec_of(
    environment: MissionEnvironment,
    traffic: Traffic,
    settings: MissionSettings,
    targets: Sequence[int],
    policy: str,
    seed: int,
) -> MissionSpec:
    """The spec of a mission over values, with inputs that were never files named as handed in."""
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
    """Tracks of other aircraft in traffic that is a value."""
    aircraft = traffic.aircraft if isinstance(traffic, Replay) else ()
    return tuple(AircraftTrack.of(each) for each in aircraft) or None
