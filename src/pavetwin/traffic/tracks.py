"""The tracks of all agents of a recording, as key frames in parts of two minutes, each loaded when it is needed.

A key frame is an agent's pose at a step. Poses that equal those before and after are left out, so an agent that stands
needs two key frames, however long it stands. Nothing is rounded: all poses are given back exactly as recorded.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, Self

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt32Array

PART_STEPS: Final = 240
"""Steps of a part, two minutes. A part also holds the first step of the next one, where its agents are going."""

STANDING_MPS: Final = 0.1
"""A slower vehicle stands; SUMO's threshold of waiting."""

TELEPORT_MPS: Final = 40.0
"""What moves faster was put elsewhere by SUMO, and is not moved by the kernel."""

COLUMNS: Final = ("x", "y", "yaw_rad", "speed_mps")


@dataclass(frozen=True, eq=False)
class PoseRows:
    """Consecutive frames with every agent's pose."""

    step_offsets: UInt32Array
    """(frames + 1,): the rows of frame k are step_offsets[k] … step_offsets[k + 1], sorted by agent."""
    agent: UInt32Array
    """(rows,) index in the recording's agents"""
    x: Float32Array
    """(rows,) centre of the body on the ground, metres east"""
    y: Float32Array
    """(rows,) metres north"""
    yaw_rad: Float32Array
    """(rows,) counter-clockwise from east, −π … π"""
    speed_mps: Float32Array
    """(rows,)"""

    def __post_init__(self) -> None:
        rows = len(self.agent)
        if len(self.step_offsets) < 2 or self.step_offsets[0] != 0 or self.step_offsets[-1] != rows:
            raise ValueError("PoseRows.step_offsets must begin with 0, end with the number of rows, and hold a frame")
        for name in COLUMNS:
            column = getattr(self, name)
            if column.shape != (rows,) or column.dtype != np.float32:
                raise ValueError(f"PoseRows.{name} must be float32 of shape ({rows},)")

    @property
    def frames(self) -> int:
        return len(self.step_offsets) - 1

    @cached_property
    def frame(self) -> Int64Array:
        """(rows,) the frame of each row."""
        return np.repeat(np.arange(self.frames), np.diff(self.step_offsets))

    def between(self, first: int, end: int) -> "PoseRows":
        """The frames from `first` up to but not `end`."""
        rows = slice(int(self.step_offsets[first]), int(self.step_offsets[end]))
        offsets = self.step_offsets[first : end + 1] - self.step_offsets[first]
        return PoseRows(offsets, *(getattr(self, name)[rows] for name in ("agent", *COLUMNS)))

    def followed_by(self, later: "PoseRows") -> "PoseRows":
        offsets = np.concatenate([self.step_offsets, self.step_offsets[-1] + later.step_offsets[1:]])
        both = (np.concatenate([getattr(self, name), getattr(later, name)]) for name in ("agent", *COLUMNS))
        return PoseRows(offsets, *both)


@dataclass(frozen=True, eq=False)
class TrackPart:
    """Key frames of some steps of a recording. All arrays (key frames,), in ascending order of (agent, step)."""

    first_step: int
    last_step: int
    """Included."""
    agent: UInt32Array
    step: UInt32Array
    """Of the recording."""
    x: Float32Array
    y: Float32Array
    yaw_rad: Float32Array
    speed_mps: Float32Array
    is_last: BoolArray
    """Whether the agent is absent after this step until its next key frame, or the part ends."""

    @classmethod
    def of(cls, rows: PoseRows, first_step: int = 0) -> Self:
        """The key frames of all poses from a step on."""
        order = np.lexsort((rows.frame, rows.agent))
        agent, frame = rows.agent[order], rows.frame[order]
        columns = {name: getattr(rows, name)[order] for name in COLUMNS}
        goes_on = (np.diff(agent.astype(np.int64)) == 0) & (np.diff(frame) == 1)
        unchanged = goes_on.copy()
        for column in columns.values():
            unchanged &= column[1:] == column[:-1]
        kept = np.ones(len(agent), dtype=np.bool_)
        kept[1:-1] = ~(unchanged[1:] & unchanged[:-1])
        return cls(
            first_step,
            first_step + rows.frames - 1,
            agent=agent[kept],
            step=(frame[kept] + first_step).astype(np.uint32),
            is_last=~np.append(goes_on, False)[kept] if len(agent) else np.zeros(0, dtype=np.bool_),
            **{name: column[kept] for name, column in columns.items()},
        )

    def load(self) -> "TrackPart":
        return self

    def rows(self) -> PoseRows:
        """All poses, every step of the part a frame."""
        count = len(self.agent)
        following = np.append(self.step[1:], 0).astype(np.int64)
        holds = ~self.is_last & np.append(self.agent[1:] == self.agent[:-1], False)[:count]
        step = self.step.astype(np.int64)
        lasts = np.where(holds, following - step, 1)
        key = np.repeat(np.arange(count), lasts)
        frame = np.arange(len(key)) - np.repeat(np.cumsum(lasts) - lasts, lasts) + step[key] - self.first_step
        order = np.argsort(frame, kind="stable")
        frames = self.last_step - self.first_step + 1
        offsets = np.concatenate([[0], np.cumsum(np.bincount(frame, minlength=frames))]).astype(np.uint32)
        return PoseRows(offsets, *(getattr(self, name)[key][order] for name in ("agent", *COLUMNS)))

    def is_as(self, other: "TrackPart") -> bool:
        return all(np.array_equal(getattr(self, each.name), getattr(other, each.name)) for each in fields(self))


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
    """What each frame holds in all. All arrays (frames,)."""

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

    parts: tuple[TrackPart | StoredPart, ...]
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
        return cls(parts, 0, FrameNumbers.of(rows, is_pedestrian), _fastest_mps(parts, step_s))

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
            (*self.parts[:-1], *longer),
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
        return made

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


def _fastest_mps(parts: Iterable[TrackPart], step_s: float) -> float:
    fastest = 0.0
    for part in parts:
        follows = ~part.is_last[:-1]
        moved_m = np.hypot(np.diff(part.x.astype(np.float64)), np.diff(part.y.astype(np.float64)))[follows]
        moved_mps = moved_m / (np.diff(part.step.astype(np.int64))[follows] * step_s)
        driven = moved_mps[moved_mps <= TELEPORT_MPS]
        fastest = max(fastest, np.abs(part.speed_mps).max(initial=0.0), driven.max(initial=0.0))
    return float(np.ceil(fastest * 1000) / 1000)
