"""Outcome of every defect of the inspected segments: found, or missed and why.

The kernel judges each capture of a defect's segment with the defect's centre in the inspection window again, with the
traffic of that moment: how much of the defect is visible, and what hides the rest. A mission flies its plan to the end,
with as many batteries as it takes, so no defect is missed because the mission ended.
"""

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, cached_property, partial
from math import hypot
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from pavetwin._core import Trace, Viewpoint
from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.config import MissionSettings
from pavetwin.detections import Detections
from pavetwin.mission.environment import MissionEnvironment, shutter_s, window_m
from pavetwin.mission.events import ActionTaken, MissionEvent
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.track import LATE_S
from pavetwin.sensing import Frame, sensor_class
from pavetwin.sensing.resolution import sighted_share
from pavetwin.twin import Place
from pavetwin.uav import camera_of
from pavetwin.uav.wind import seen_velocity_mps
from pavetwin.world.model import Defect

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, DefectShares, TrackColumns


class DefectWatch:
    """Visible shares of defects, computed when their segment ends, while the traffic of that time is in memory.

    After landing, the traffic would have to be read again.
    """

    def __init__(self, environment: MissionEnvironment, settings: MissionSettings) -> None:
        self._environment, self._settings = environment, settings
        self.shares: dict[tuple[int, int], DefectShares] = {}
        """Shares by id of the defect and number of the capture."""

    def look_back(self, segment: int, captures: "CaptureColumns", confirmed: Container[int], trace: Trace) -> None:
        """Compute the shares of a segment's defects that are not confirmed.

        Args:
            segment: index of the segment.
            captures: the captures of the mission so far.
            confirmed: ids of the confirmed defects.
        """
        environment = self._environment
        for number in environment.defects_by_segment.get(environment.world.segments[segment].id, ()):
            if number not in confirmed:
                for capture in captures_of(environment.defects[number], captures, segment, self._settings).tolist():
                    self.shares[number, capture] = shares_of(number, capture, captures, environment, trace)


def captures_of(defect: Defect, captures: "CaptureColumns", segment: int, settings: MissionSettings) -> IndexArray:
    """Rows of the captures of a segment, by its index, with a defect's centre in the inspection window."""
    rows = np.flatnonzero(captures["segment"] == segment)
    return rows[in_window(defect, captures["x_m"][rows], captures["y_m"][rows], captures["yaw_rad"][rows], settings)]


def in_window(
    defect: Defect, x_m: Float64Array, y_m: Float64Array, yaw_rad: Float64Array, settings: MissionSettings
) -> IndexArray:
    """Indices of the UAV's places with a defect's centre in the inspection window."""
    across_m, along_m = window_m(settings)
    east, north = defect.centre.x - x_m, defect.centre.y - y_m
    ahead_east, ahead_north = np.cos(yaw_rad), np.sin(yaw_rad)
    along, across = east * ahead_east + north * ahead_north, north * ahead_east - east * ahead_north
    return np.flatnonzero((np.abs(along) <= along_m / 2) & (np.abs(across) <= across_m / 2))


def shares_of(
    defect: int, capture: int, captures: "CaptureColumns", environment: MissionEnvironment, trace: Trace
) -> "DefectShares":
    """Shares of a defect that are visible and hidden in a capture, by what hides them."""
    viewpoint = Viewpoint(
        position=(float(captures["x_m"][capture]), float(captures["y_m"][capture])),
        altitude_m=environment.altitude_m,
        yaw_rad=float(captures["yaw_rad"][capture]),
    )
    return environment.ground.defect_shares(defect, trace, float(captures["t_s"][capture]), viewpoint)


class MissReason(StrEnum):
    """Why a defect was missed; the first that applies."""

    OUTSIDE_SWATH = "outside_swath"
    """The inspection window never passed over its centre."""
    BETWEEN_CAPTURES = "between_captures"
    """The window passed over its centre, but no capture was taken then."""
    TOO_SMALL = "too_small"
    """At least one capture showed enough of it, and in each that did it covered too few pixels for the sensor to see
    it (`sensing.least_px`)."""
    NOT_RECOGNISED = "not_recognised"
    """At least one capture showed enough of it, and the sensor reported nothing that matches."""
    HIDDEN_BY_VEHICLES = "hidden_by_vehicles"
    """Every capture showed too little of it; vehicles in traffic hid most of it, on average over these captures."""
    HIDDEN_BY_PARKED_VEHICLES = "hidden_by_parked_vehicles"
    """It lies under or behind a parked vehicle: hidden permanently."""
    HIDDEN_BY_PEDESTRIANS = "hidden_by_pedestrians"
    HIDDEN_BY_FIXED_OBJECTS = "hidden_by_fixed_objects"
    """Buildings, trees, street furniture."""

    @property
    def words(self) -> str:
        """The reason in a sentence on missed defects."""
        return _WORDS[self]


_WORDS: Final[Mapping[MissReason, str]] = {
    MissReason.HIDDEN_BY_VEHICLES: "hidden by vehicles in traffic",
    MissReason.HIDDEN_BY_PARKED_VEHICLES: "under or behind a parked vehicle",
    MissReason.HIDDEN_BY_PEDESTRIANS: "hidden by pedestrians",
    MissReason.HIDDEN_BY_FIXED_OBJECTS: "hidden by buildings, trees or street furniture",
    MissReason.TOO_SMALL: "too small for the pixels",
    MissReason.NOT_RECOGNISED: "seen but not recognised by the sensor",
    MissReason.BETWEEN_CAPTURES: "between two captures",
    MissReason.OUTSIDE_SWATH: "outside the camera's swath",
}
"""Reasons in the order of sentences."""


def missed_words(reasons: Mapping[MissReason | None, int]) -> str:
    """`3 hidden by vehicles in traffic, 1 too small for the pixels`; empty if nothing was missed.

    Args:
        reasons: number of defects by reason; None, for found defects, is left out.
    """
    return ", ".join(f"{count} {words}" for reason, words in _WORDS.items() if (count := reasons.get(reason)))


HIDDEN: Mapping[MissReason, str] = {
    MissReason.HIDDEN_BY_VEHICLES: "behind_vehicles",
    MissReason.HIDDEN_BY_PARKED_VEHICLES: "behind_parked",
    MissReason.HIDDEN_BY_PEDESTRIANS: "behind_pedestrians",
    MissReason.HIDDEN_BY_FIXED_OBJECTS: "behind_solids",
}
"""The reasons of hidden defects, each with the kernel's name of the hidden share."""


class PolicyResponse(StrEnum):
    """Response of the policy to a hidden defect."""

    NOT_ASKED = "not_asked"
    """The visibility of the window stayed at τ_o or above, so the policy was not asked."""
    GO_ON = "go_on"
    """The policy was asked and flew on."""
    WAIT = "wait"
    DISPLACE = "displace"
    REVISIT = "revisit"


@dataclass(frozen=True, slots=True)
class InspectedDefect:
    """Outcome of one defect."""

    defect: Defect
    reason: MissReason | None
    """None for a found defect."""
    captures: int
    """Number of captures of its segment with its centre in the inspection window."""
    captures_on_revisit: int
    """Number of these during revisits."""
    capture: int | None
    """The capture that confirmed it; for a missed defect the first capture that showed most of it."""
    time_s: float | None
    """Time of that capture."""
    visible_fraction: float | None
    """Visible share of its area in that capture."""
    on_revisit: bool | None
    """True if that capture was taken during a revisit."""
    hidden_by: Mapping[MissReason, float] | None
    """For a hidden defect, the hidden shares of its area, means over the captures."""
    responses: tuple[PolicyResponse, ...] = ()
    """For a hidden defect, the policy's responses while its centre was in the inspection window, and its revisits."""

    @property
    def is_found(self) -> bool:
        return self.reason is None


class FlownMission(Protocol):
    """The part of a mission's result that decides what became of its defects."""

    @property
    def environment(self) -> MissionEnvironment: ...
    @property
    def settings(self) -> MissionSettings: ...
    @property
    def rows(self) -> Sequence[SegmentMetrics]: ...
    @property
    def track(self) -> "TrackColumns": ...
    @property
    def captures(self) -> "CaptureColumns": ...
    @property
    def swept(self) -> Container[int]: ...
    @property
    def events(self) -> Sequence[MissionEvent]: ...
    @property
    def confirmed(self) -> Detections: ...
    @property
    def trace(self) -> Trace: ...
    @property
    def known_shares(self) -> Mapping[tuple[int, int], "DefectShares"]: ...


def inspected_defects(result: FlownMission) -> tuple[InspectedDefect, ...]:
    """The outcome of every defect of the inspected segments, in the order of inspection."""
    return tuple(_Judge(result).outcomes())


def captured_frame(result: FlownMission, capture: int) -> Frame:
    """The frame of a capture, without sightings.

    Args:
        capture: index in `result.captures`.
    """
    settings, columns = result.settings, result.captures
    time_s = float(columns["t_s"][capture])
    return Frame(
        number=capture,
        time_s=time_s,
        position=(float(columns["x_m"][capture]), float(columns["y_m"][capture])),
        altitude_m=settings.altitude_m,
        yaw_rad=float(columns["yaw_rad"][capture]),
        camera=camera_of(settings),
        conditions=settings.conditions,
        velocity_mps=seen_velocity_mps(settings, _velocity_mps(result, capture), time_s),
        exposure_s=shutter_s(settings),
        sun_elevation_deg=result.environment.sun_elevation_deg(settings.conditions),
    )


def _velocity_mps(result: FlownMission, capture: int) -> Place:
    """Velocity over the ground at a capture: the track's speed, in the direction in which its position changes.

    That is not always the yaw: displacements go sideways.
    """
    track, captures = result.track, result.captures
    row = int(np.searchsorted(track["t_s"], captures["t_s"][capture] - LATE_S))
    before, after = max(row - 1, 0), min(row + 1, len(track["t_s"]) - 1)
    east, north = (float(track[name][after] - track[name][before]) for name in ("x_m", "y_m"))
    way_m, speed_mps = hypot(east, north), float(track["speed_mps"][row])
    return (speed_mps * east / way_m, speed_mps * north / way_m) if way_m else (0.0, 0.0)


@dataclass(frozen=True)
class _Judge:
    result: FlownMission

    def outcomes(self) -> Iterator[InspectedDefect]:
        environment = self.result.environment
        confirmations = {defect: row for row, defect in enumerate(self.result.confirmed.defect.tolist())}
        for segment in dict.fromkeys(row.segment for row in self.result.rows):
            for number in environment.defects_by_segment.get(segment, ()):
                defect = environment.defects[number]
                captures = self._captures_of(defect)
                confirmation = confirmations.get(number)
                yield self._missed(defect, captures) if confirmation is None else self._found(captures, confirmation)

    def _found(self, captures: IndexArray, confirmation: int) -> InspectedDefect:
        """Args:
        confirmation: row in the result's `confirmed`.
        """
        found = self.result.confirmed
        return InspectedDefect(
            defect=self.result.environment.defects[found.defect[confirmation]],
            reason=None,
            captures=len(captures),
            captures_on_revisit=self._on_revisit(captures),
            capture=int(found.capture[confirmation]),
            time_s=float(found.time_s[confirmation]),
            visible_fraction=float(found.visible_fraction[confirmation]),
            on_revisit=bool(found.on_revisit[confirmation]),
            hidden_by=None,
        )

    def _missed(self, defect: Defect, captures: IndexArray) -> InspectedDefect:
        if not len(captures):
            reason = MissReason.BETWEEN_CAPTURES if defect.id in self.result.swept else MissReason.OUTSIDE_SWATH
            return InspectedDefect(defect, reason, 0, 0, None, None, None, None, None)
        shares = [self._shares(defect.id, int(capture)) for capture in captures]
        visible = [share["visible"] for share in shares]
        best = int(np.argmax(visible))
        means = {
            reason: float(np.mean([share[column] for share in shares]))  # type: ignore[literal-required]
            for reason, column in HIDDEN.items()
        }
        is_hidden = visible[best] < self.result.settings.sensing.min_visible_fraction
        columns, capture = self.result.captures, int(captures[best])
        not_found = MissReason.TOO_SMALL if self._too_small(defect, captures, visible) else MissReason.NOT_RECOGNISED
        return InspectedDefect(
            defect=defect,
            reason=max(means, key=lambda reason: means[reason]) if is_hidden else not_found,
            captures=len(captures),
            captures_on_revisit=self._on_revisit(captures),
            capture=capture,
            time_s=float(columns["t_s"][capture]),
            visible_fraction=visible[best],
            on_revisit=bool(columns["on_revisit"][capture]),
            hidden_by=means if is_hidden else None,
            responses=self._responses(defect, captures) if is_hidden else (),
        )

    def _captures_of(self, defect: Defect) -> IndexArray:
        """Rows of the captures of a defect's segment with its centre in the inspection window."""
        return captures_of(defect, self.result.captures, self._indices[defect.segment], self.result.settings)

    def _shares(self, defect: int, capture: int) -> "DefectShares":
        known = self.result.known_shares.get((defect, capture))
        if known is not None:
            return known
        result = self.result
        return shares_of(defect, capture, result.captures, result.environment, result.trace)

    def _too_small(self, defect: Defect, captures: IndexArray, visible: Sequence[float]) -> bool:
        """True if the defect covered too few pixels in every capture that showed enough of it."""
        sensing, environment = self.result.settings.sensing, self.result.environment
        if not sensor_class(sensing.sensor).judges_size:
            return False
        return not any(
            sighted_share(sensing, self._frame_of(int(capture)), environment.sighting(defect.id, fraction, 0))
            for capture, fraction in zip(captures, visible, strict=True)
            if fraction >= sensing.min_visible_fraction
        )

    @cached_property
    def _frame_of(self) -> Callable[[int], Frame]:
        """`captured_frame`, cached: a frame shows many defects."""
        return cache(partial(captured_frame, self.result))

    def _on_revisit(self, captures: IndexArray) -> int:
        return int(np.count_nonzero(self.result.captures["on_revisit"][captures]))

    def _responses(self, defect: Defect, captures: IndexArray) -> tuple[PolicyResponse, ...]:
        """The policy's responses, each kind once, in order; see `InspectedDefect.responses`."""
        track, rows = self.result.track, self._rows_of_actions
        x_m, y_m, yaw_rad = track["x_m"][rows], track["y_m"][rows], track["yaw_rad"][rows]
        above = in_window(defect, x_m, y_m, yaw_rad, self.result.settings)
        above = above[track["segment"][rows[above]] == self._indices[defect.segment]]
        done = [PolicyResponse(type(self._actions[number].action).__name__.lower()) for number in above]
        if self._on_revisit(captures):
            done.append(PolicyResponse.REVISIT)
        if done:
            return tuple(dict.fromkeys(done))
        columns = self.result.captures
        low = columns["visibility"][captures] < self.result.settings.visibility.threshold
        return (PolicyResponse.GO_ON if low.any() else PolicyResponse.NOT_ASKED,)

    @cached_property
    def _indices(self) -> Mapping[str, int]:
        return {segment.id: index for index, segment in enumerate(self.result.environment.world.segments)}

    @cached_property
    def _actions(self) -> list[ActionTaken]:
        return [event for event in self.result.events if isinstance(event, ActionTaken)]

    @cached_property
    def _rows_of_actions(self) -> IndexArray:
        """Rows of the track at which the policy acted: every look is a row, and the policy is asked at looks."""
        times = np.array([action.time_s for action in self._actions])
        return np.searchsorted(self.result.track["t_s"][:-1], times - LATE_S)
