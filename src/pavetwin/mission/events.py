"""Events of a mission, in the order of time. A mission keeps them all and passes each to its observer.

```python
def show(event: MissionEvent) -> None:
    print(f"{event.time_s:6.1f} s  {event}")

fly(…, observer=show)
```

The observer is called at once, in the process and thread that flies. It does not change the flight; an error that it
raises ends the mission.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pavetwin.policies import Action
from pavetwin.twin import Note, Place


@dataclass(frozen=True, slots=True)
class MissionEvent:
    """Something that happened, `time_s` seconds into the mission."""

    time_s: float


@dataclass(frozen=True, slots=True)
class SegmentStarted(MissionEvent):
    """The UAV sets out for a segment."""

    segment: int
    """Index in the world's segments, here and below."""


@dataclass(frozen=True, slots=True)
class SegmentFinished(MissionEvent):
    segment: int


@dataclass(frozen=True, slots=True)
class OcclusionStarted(MissionEvent):
    """Visibility fell below τ_o."""

    segment: int
    visibility: float


@dataclass(frozen=True, slots=True)
class ActionTaken(MissionEvent):
    """The policy decided on something other than flying on."""

    position: Place
    """Position of the UAV."""
    action: Action


@dataclass(frozen=True, slots=True)
class DefectsConfirmed(MissionEvent):
    """A capture confirmed defects that were not confirmed before."""

    defects: tuple[int, ...]
    on_revisit: bool


@dataclass(frozen=True, slots=True)
class NoteVisited(MissionEvent):
    """The UAV sets out for a noted place."""

    note: Note


@dataclass(frozen=True, slots=True)
class BatteryRanLow(MissionEvent):
    """The UAV turns back to its base for another battery."""

    position: Place


@dataclass(frozen=True, slots=True)
class SegmentOutOfReach(MissionEvent):
    """A full battery does not bring the UAV to a segment, along it and home: the mission ends with an error."""

    segment: int


@dataclass(frozen=True, slots=True)
class BatterySwapped(MissionEvent):
    """The full battery is in place; the UAV takes off again."""


@dataclass(frozen=True, slots=True)
class ProgressMade(MissionEvent):
    """A pass or a segment was finished."""

    share: float
    """Approximate share of the passes flown; 1 before the way home."""


MissionObserver = Callable[[MissionEvent], None]
