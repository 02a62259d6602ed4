"""Timeline of a mission, flown or in flight: the whole twin at any moment.

```python
timeline = Timeline(result)                   # or Timeline(mission), at any pause
state = timeline.at(73.5)
state.uav.position, state.visibility, state.found, state.missed
timeline.events(60.0, 90.0)                   # the events in between
```

A timeline of a mission in flight ends at the moment at which it was created; create another one later.
"""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from math import inf
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

import numpy as np

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.detections import Detections
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment, parked_columns
from pavetwin.mission.events import (
    ActionTaken,
    BatteryRanLow,
    BatterySwapped,
    DefectsConfirmed,
    MissionEvent,
    NoteVisited,
    OcclusionStarted,
    SegmentFinished,
)
from pavetwin.mission.mission import Mission
from pavetwin.mission.result import MissionResult
from pavetwin.mission.track import LATE_S, MODE_NUMBER, MODES, activity, inspecting
from pavetwin.policies import Revisit
from pavetwin.twin import Agent, Confirmation, Mode, Note, Place, UavState
from pavetwin.twin.state import agents_of
from pavetwin.world.model import Segment

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, PoseColumns, TrackColumns


@dataclass(frozen=True)
class TimelineState:
    """D_t at one moment of a mission, with the actions and detections up to it."""

    time_s: float
    uav: UavState
    """x_t, interpolated. Its yaw is continuous over the mission, beyond ±π too."""
    segment: Segment | None
    """s*: the one that the UAV is at."""
    visibility: float | None
    """o_{s*,t} at the last look; None while nothing is under inspection."""
    captures: int
    """Number of captures so far: the first rows of the timeline's `captures`."""
    detections: Detections
    """All detections, including false alarms and duplicates, in the order of time."""
    found: Mapping[int, Confirmation]
    """The confirmed defects, by their id."""
    missed: frozenset[int]
    """Ids of the defects of finished segments that are not confirmed so far."""
    finished: tuple[int, ...]
    """Indices of the finished segments, in order."""
    actions: tuple[ActionTaken, ...]
    notes: tuple[Note, ...]
    """Places that are still to be visited again."""
    wait_s: float
    """Time waited in total, to one sample of the track."""
    energy: float
    """Energy used, in batteries, to one sample of the track."""
    occlusions: int
    swaps: int
    _timeline: "Timeline" = field(repr=False, compare=False)

    @property
    def parked(self) -> tuple[Agent, ...]:
        """The vehicles that stand parked during the whole mission."""
        return self._timeline.environment.parked_agents

    @cached_property
    def agents(self) -> tuple[Agent, ...]:
        """A_t: every moving agent in the world."""
        return agents_of(self._timeline.trace.agents_at(self.time_s))

    def agents_near(self, place: Place, radius_m: float) -> "PoseColumns":
        """Agents whose body may reach into the disc, one array per column."""
        return self._timeline.trace.agents_near(*place, radius_m, self.time_s)


class Timeline:
    """A mission's columns over time (`track`, `captures`), its events, and its state at any moment."""

    def __init__(self, mission: MissionResult | Mission) -> None:
        self.environment: MissionEnvironment = mission.environment
        self.settings = mission.settings
        self.policy = mission.policy
        self.captures: CaptureColumns
        self.track: TrackColumns
        if isinstance(mission, Mission):
            self.duration_s, self.trace = mission.flight.time_s, mission.traffic.trace()
            self.track, self.captures = _track_until_now(mission), mission.flight.captures()
            self._detections = mission.detections.all
        else:
            self.duration_s, self.trace = mission.duration_s, mission.trace
            self.track, self.captures = mission.track, mission.captures
            self._detections = mission.detections
        self._events = tuple(mission.events)
        self._event_times_s = [event.time_s for event in self._events]

    def at(self, time_s: float) -> TimelineState:
        """The state at a moment from 0 to `duration_s`.

        Raises:
            PaveTwinError: the mission has no such moment.
        """
        if not 0 <= time_s <= self.duration_s + LATE_S:
            raise PaveTwinError(f"The mission has no moment at {time_s:g} s; it lasts {self.duration_s:.1f} s so far.")
        row = self.row(time_s)
        segment, visibility = int(self.track["segment"][row]), float(self.track["visibility"][row])
        segments, defects_of = self.environment.world.segments, self.environment.defects_by_segment
        found: dict[int, Confirmation] = {}
        finished: list[int] = []
        actions: list[ActionTaken] = []
        notes: list[Note] = []
        occlusions = swaps = 0
        for event in self.events(0.0, time_s):
            match event:
                case DefectsConfirmed(when_s, defects, on_revisit):
                    found |= dict.fromkeys(defects, Confirmation(when_s, on_revisit))
                case SegmentFinished(segment=left):
                    finished.append(left)
                case ActionTaken(when_s, _, action):
                    actions.append(event)
                    if isinstance(action, Revisit):
                        notes.append(Note(action.place, when_s, action.stay_s))
                case NoteVisited(note=note):
                    notes.remove(note)
                case OcclusionStarted():
                    occlusions += 1
                case BatterySwapped():
                    swaps += 1
        return TimelineState(
            time_s=time_s,
            uav=UavState(
                position=(float(self.interpolated("x_m", time_s)), float(self.interpolated("y_m", time_s))),
                altitude_m=float(self.interpolated("altitude_m", time_s)),
                speed_mps=float(self.interpolated("speed_mps", time_s)),
                battery=float(self.interpolated("battery", time_s)),
                yaw_rad=float(np.interp(time_s, self.track["t_s"], self.yaw_rad)),
                mode=MODES[int(self.activity[row])],
            ),
            segment=None if segment < 0 else segments[segment],
            visibility=visibility if np.isfinite(visibility) else None,
            captures=self.capture_count(time_s),
            detections=self._detections[: int(np.searchsorted(self._detections.time_s, time_s, "right"))],
            found=MappingProxyType(found),
            missed=frozenset(chain(*(defects_of.get(segments[left].id, ()) for left in finished))).difference(found),
            finished=tuple(finished),
            actions=tuple(actions),
            notes=tuple(notes),
            wait_s=float(np.interp(time_s, self.track["t_s"], self._waited_s)),
            energy=float(np.interp(time_s, self.track["t_s"], self._used)),
            occlusions=occlusions,
            swaps=swaps,
            _timeline=self,
        )

    def events(self, start_s: float = 0.0, end_s: float = inf) -> tuple[MissionEvent, ...]:
        """Events from `start_s` to `end_s`, both included, in order."""
        first = bisect_right(self._event_times_s, np.nextafter(start_s, -inf))
        return self._events[first : bisect_right(self._event_times_s, end_s)]

    def row(self, time_s: float) -> int:
        """The track's last sample up to a moment."""
        return max(0, int(np.searchsorted(self.track["t_s"], time_s + LATE_S)) - 1)

    def capture_count(self, time_s: float) -> int:
        """Number of rows of `captures` up to a moment."""
        return int(np.searchsorted(self.captures["t_s"], time_s + LATE_S, side="right"))

    def interpolated(self, column: str, time_s: float | Float64Array) -> Float64Array:
        """A column of the track at one or many moments, constant beyond its ends."""
        return np.asarray(np.interp(time_s, self.track["t_s"], self.track[column]))  # type: ignore[literal-required]

    def trail(self, time_s: float, seconds: float) -> Float64Array:
        """(n, 2) positions of the last `seconds`."""
        past = (self.track["t_s"] > time_s - seconds) & (self.track["t_s"] <= time_s)
        return np.column_stack([self.track["x_m"][past], self.track["y_m"][past]])

    @cached_property
    def parked(self) -> "PoseColumns":
        """The vehicles that stand parked during the whole mission, one array per column."""
        return parked_columns(self.environment.parked)

    @cached_property
    def activity(self) -> UInt8Array:
        """(n,) activity at each sample of the track, see `pavetwin.mission.track.activity`."""
        return activity(self.track)

    def first_reaction_s(self) -> float:
        """Time of the policy's first reaction or low battery; else of the first occlusion, the first look, or 0."""
        reactions = [e.time_s for e in self._events if isinstance(e, ActionTaken | BatteryRanLow)]
        if reactions:
            return reactions[0]
        looks = inspecting(self.track)
        low = looks & (np.nan_to_num(self.track["visibility"], nan=1.0) < self.settings.visibility.threshold)
        rows = np.flatnonzero(low) if low.any() else np.flatnonzero(looks)
        return float(self.track["t_s"][rows[0]]) if len(rows) else 0.0

    @cached_property
    def yaw_rad(self) -> Float64Array:
        """(n,) the yaw at each sample of the track, continuous over the mission, beyond ±π too."""
        return np.asarray(np.unwrap(self.track["yaw_rad"]))

    @cached_property
    def _waited_s(self) -> Float64Array:
        """(n,) seconds waited before each sample."""
        waiting = self.activity[:-1] == MODE_NUMBER[Mode.WAIT]
        return np.concatenate([[0.0], np.cumsum(np.diff(self.track["t_s"]) * waiting)])

    @cached_property
    def _used(self) -> Float64Array:
        """(n,) batteries used before each sample; the rise of a swap is not a use."""
        return np.concatenate([[0.0], np.cumsum(np.maximum(0.0, -np.diff(self.track["battery"])))])


def _track_until_now(mission: Mission) -> "TrackColumns":
    """The track of a mission in flight, up to its present moment."""
    track, flight = mission.flight.track(), mission.flight
    if len(track["t_s"]) and track["t_s"][-1] >= flight.time_s:
        return track
    (x_m, y_m), started = flight.position, len(track["t_s"]) > 0
    now = {
        **{"t_s": flight.time_s, "x_m": x_m, "y_m": y_m},
        **{name: getattr(flight, name) for name in ("altitude_m", "yaw_rad", "speed_mps", "battery", "mode")},
        "segment": track["segment"][-1] if started else -1,
        "visibility": track["visibility"][-1] if started else np.nan,
    }
    columns = cast("dict[str, Float64Array]", track)
    longer = {name: np.append(column, np.asarray(now[name], column.dtype)) for name, column in columns.items()}
    return cast("TrackColumns", longer)
