"""The tracks of all agents of a recording, as key frames in parts of two minutes, each loaded when it is needed."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, Self

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.traffic.part_file import PackedPart
from pavetwin.traffic.pose_rows import COLUMNS, PoseRows
from pavetwin.traffic.track_part import TrackPart

PART_STEPS: Final = 240
"""Steps of a part, two minutes. A part also holds the first step of the next one, where its agents are going."""

STANDING_MPS: Final = 0.1
"""A slower vehicle stands; SUMO's threshold of waiting."""

TELEPORT_MPS: Final = 40.0
"""What moves faster was put elsewhere by SUMO, and is not moved by the kernel."""


@dataclass(frozen=True, eq=False)
class StoredPart:
    """A part in a file."""

    first_step: int
    last_step: int
    read: Callable[[], TrackPart]

    def load(self) -> TrackPart:
        """Raises:
        PaveTwinError: the file is damaged.
        """
        return self.read()


@dataclass(frozen=True, eq=False)
class FrameNumbers:
    """What each frame holds in all, of poses before they are rounded. All arrays (frames,)."""

    vehicles: Int64Array
    pedestrians: Int64Array
    known: Int64Array
    """How many agents have appeared so far."""
    standing: Int64Array
    """Vehicles that stand."""
    speed_mps: Float64Array
    """Sum over the vehicles."""

    @classmethod
    def of(cls, rows: PoseRows, is_pedestrian: BoolArray, known: int = 0) -> Self:
        """Those of the next frames, after frames in which `known` agents have appeared."""
        drives = ~is_pedestrian[rows.agent]
        speed = rows.speed_mps.astype(np.float64)
        highest = np.full(rows.frames, known, dtype=np.int64)
        filled = np.flatnonzero(np.diff(rows.step_offsets))
        last = rows.agent[rows.step_offsets[filled + 1] - 1].astype(np.int64)  # sorted within a frame
        highest[filled] = np.maximum(highest[filled], last + 1)

        def counted(chosen: BoolArray) -> Int64Array:
            return np.bincount(rows.frame[chosen], minlength=rows.frames).astype(np.int64)

        return cls(
            vehicles=counted(drives),
            pedestrians=counted(~drives),
            known=np.maximum.accumulate(highest),
            standing=counted(drives & (rows.speed_mps < STANDING_MPS)),
            speed_mps=np.bincount(rows.frame[drives], speed[drives], rows.frames).astype(np.float64),
        )

    def between(self, first: int, end: int) -> "FrameNumbers":
        return FrameNumbers(*(getattr(self, each.name)[first:end] for each in fields(self)))

    def followed_by(self, later: "FrameNumbers") -> "FrameNumbers":
        both = (np.concatenate([getattr(self, each.name), getattr(later, each.name)]) for each in fields(self))
        return FrameNumbers(*both)


@dataclass(frozen=True, eq=False)
class AgentTracks:
    """Frames of a recording, a window of all that its parts hold."""

    parts: tuple[TrackPart | PackedPart | StoredPart, ...]
    """Of the whole recording: part k begins at step k · `PART_STEPS` and ends where the next one begins."""
    first_step: int
    """The window's."""
    numbers: FrameNumbers
    """Of the window's frames."""
    fastest_mps: float
    """At least the largest speed, and displacement over time of what moves."""

    @classmethod
    def of(cls, rows: PoseRows, is_pedestrian: BoolArray, step_s: float) -> Self:
        parts = tuple(_parts(rows, 0))
        return cls(_packed(parts), 0, FrameNumbers.of(rows, is_pedestrian), _fastest_mps(parts, step_s))

    @property
    def frames(self) -> int:
        return len(self.numbers.vehicles)

    @property
    def is_stored(self) -> bool:
        """Whether all parts are in a file."""
        return all(isinstance(part, StoredPart) for part in self.parts)

    @property
    def starts(self) -> tuple[int, ...]:
        """The first step of each part."""
        return tuple(part.first_step for part in self.parts)

    def between(self, first: int, end: int) -> "AgentTracks":
        """The window's frames from `first` up to but not `end`."""
        return replace(self, first_step=self.first_step + first, numbers=self.numbers.between(first, end))

    def followed_by(self, rows: PoseRows, is_pedestrian: BoolArray, step_s: float) -> "AgentTracks":
        """Longer by some frames; of a window that is the whole recording."""
        last = self.parts[-1].load()
        known = int(self.numbers.known[-1])
        longer = tuple(_parts(last.rows().followed_by(rows), last.first_step))
        return AgentTracks(
            (*self.parts[:-1], *_packed(longer)),
            self.first_step,
            self.numbers.followed_by(FrameNumbers.of(rows, is_pedestrian, known)),
            max(self.fastest_mps, _fastest_mps(longer, step_s)),
        )

    def copied(self, is_pedestrian: BoolArray, step_s: float) -> "AgentTracks":
        """The window as a recording of its own."""
        pieces = (rows for _, rows in self.pieces())
        made = AgentTracks.of(next(pieces), is_pedestrian, step_s)
        for rows in pieces:
            made = made.followed_by(rows, is_pedestrian, step_s)
        return replace(made, numbers=self.numbers)  # those of the poses before they were rounded

    def pieces(self) -> Iterator[tuple[int, PoseRows]]:
        """The window's rows part by part, each with the frame of the window that it begins with."""
        end = self.first_step + self.frames
        for part, following in pairwise([*self.parts, None]):
            assert part is not None
            last = part.last_step + 1 if following is None else following.first_step
            first, last = max(part.first_step, self.first_step), min(last, end)
            if first < last:
                rows = part.load().rows()
                yield first - self.first_step, rows.between(first - part.first_step, last - part.first_step)

    @cached_property
    def rows(self) -> PoseRows:
        """All rows of the window, in memory."""
        pieces = [rows for _, rows in self.pieces()]
        begins = np.cumsum([0, *(len(rows.agent) for rows in pieces)])
        shifted = [rows.step_offsets[1:] + begin for rows, begin in zip(pieces, begins, strict=False)]
        columns = (np.concatenate([getattr(rows, name) for rows in pieces]) for name in ("agent", *COLUMNS))
        return PoseRows(np.concatenate([[0], *shifted]).astype(np.uint32), *columns)

    def begin_alike(self, other: "AgentTracks") -> bool:
        """Whether the shorter of two whole recordings is the beginning of the other."""
        frames = min(self.frames, other.frames)
        for first in range(0, frames, PART_STEPS):  # their own parts may end elsewhere: a last one holds a step more
            end = min(first + PART_STEPS, frames)
            rows, others = self.between(first, end).rows, other.between(first, end).rows
            if any(not np.array_equal(getattr(rows, each.name), getattr(others, each.name)) for each in fields(rows)):
                return False
        return True


def _parts(rows: PoseRows, first_step: int) -> Iterator[TrackPart]:
    """The parts of frames that begin with a part's first step."""
    for begin in range(0, max(rows.frames - 1, 1), PART_STEPS):
        end = min(begin + PART_STEPS + 1, rows.frames)
        yield TrackPart.of(rows.between(begin, end), first_step + begin)


def _packed(parts: Sequence[TrackPart]) -> tuple[TrackPart | PackedPart, ...]:
    """All but the last, which may go on, packed: a recording is hours long."""
    return (*(PackedPart.of(part) for part in parts[:-1]), *parts[-1:])


def _fastest_mps(parts: Iterable[TrackPart], step_s: float) -> float:
    fastest = 0.0
    for part in parts:
        follows = ~part.is_last[:-1]
        x, y, _, speed_mps = part.poses()
        moved_m = np.hypot(np.diff(x.astype(np.float64)), np.diff(y.astype(np.float64)))[follows]
        moved_mps = moved_m / (np.diff(part.step.astype(np.int64))[follows] * step_s)
        driven = moved_mps[moved_mps <= TELEPORT_MPS]
        fastest = max(fastest, np.abs(speed_mps).max(initial=0.0), driven.max(initial=0.0))
    return float(np.ceil(fastest * 1000) / 1000)
