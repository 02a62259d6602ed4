"""The tracks of all agents of a recording, as key frames in parts of two minutes, each loaded when it is needed.

A key frame is an agent's pose at a step, rounded to whole units. Poses equal to those before and after are left out, so
a standing agent needs two key frames, however long it stands. Rounding depends on the pose alone, so a recording that
is extended or recorded in other parts holds the same poses.

Parts are row groups of Parquet, in a file or in memory, of columns that compress well: differences, as small natural
numbers. Agent, step and heading: the difference from the key frame before. Place: the difference of two successive
displacements; zero for an agent in even motion. Speed: the difference from the speed of that displacement in half a
second. The first key frame of an agent is no exception. Differences wrap around at 32 bits, as their sums do. Whole
numbers are folded: 0, −1, 1, −2, 2 … become 0, 1, 2, 3, 4 …

Arrays go to Arrow and back by their buffers: `pyarrow.array` and `to_numpy` would load pandas, a quarter of a second.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pavetwin.arrays import (
    AnyArray,
    BoolArray,
    Float32Array,
    Float64Array,
    FloatArray,
    Int32Array,
    Int64Array,
    UInt32Array,
)

POSE_COLUMNS: Final = ("x", "y", "yaw_rad", "speed_mps")


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
        for name in POSE_COLUMNS:
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
        return PoseRows(offsets, *(getattr(self, name)[rows] for name in ("agent", *POSE_COLUMNS)))

    def followed_by(self, later: "PoseRows") -> "PoseRows":
        offsets = np.concatenate([self.step_offsets, self.step_offsets[-1] + later.step_offsets[1:]])
        both = (np.concatenate([getattr(self, name), getattr(later, name)]) for name in ("agent", *POSE_COLUMNS))
        return PoseRows(offsets, *both)


PER_METRE: Final = 40
"""Units of place: 2.5 cm. A place is off by 1.25 cm at most east and north, so by 1.8 cm in all."""

YAW_DEG: Final = 1.0
"""Unit of headings, which are off by half of it at most."""

PER_MPS: Final = 10
"""Units of speed: 0.1 m/s. A speed is off by half of it at most."""

FURTHEST_M: Final = 1e7
"""No coordinate on Earth is larger."""

POSE: Final = ("x", "y", "yaw", "speed")


@dataclass(frozen=True, eq=False)
class TrackPart:
    """All arrays (key frames,), in ascending order of (agent, step)."""

    first_step: int
    last_step: int
    """Included."""
    agent: UInt32Array
    step: UInt32Array
    """Step of the recording."""
    x: Int32Array
    """Whole numbers of 1 / `PER_METRE`, east."""
    y: Int32Array
    """North."""
    yaw: Int32Array
    """Whole numbers of `YAW_DEG`, −180 (not included) … 180."""
    speed: Int32Array
    """Whole numbers of 1 / `PER_MPS`."""
    is_last: BoolArray
    """Whether the agent is absent after this step until its next key frame, or the part ends."""

    @classmethod
    def of(cls, rows: PoseRows, first_step: int = 0) -> Self:
        """The key frames of all poses from a step on.

        Raises:
            ValueError: a pose is not on Earth.
        """
        order = np.lexsort((rows.frame, rows.agent))
        agent, frame = rows.agent[order], rows.frame[order]
        columns = {name: column[order] for name, column in zip(POSE, _rounded(rows), strict=True)}
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

    def poses(self) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
        """Columns of `PoseRows`: x, y, yaw_rad, speed_mps."""
        yaw_rad = np.radians(self.yaw * YAW_DEG).astype(np.float32)
        return _float32(self.x, PER_METRE), _float32(self.y, PER_METRE), yaw_rad, _float32(self.speed, PER_MPS)

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
        return PoseRows(offsets, self.agent[key][order], *(column[key][order] for column in self.poses()))

    def is_as(self, other: "TrackPart") -> bool:
        return all(np.array_equal(getattr(self, each.name), getattr(other, each.name)) for each in fields(self))


def _rounded(rows: PoseRows) -> Iterator[Int32Array]:
    """The columns of `POSE`, in whole units."""
    for metres in (rows.x, rows.y):
        if not (np.abs(metres) <= FURTHEST_M).all():
            raise ValueError("PoseRows: a coordinate is not a number of metres on Earth")
        yield _whole(metres, PER_METRE)
    yaw = _whole(np.degrees(rows.yaw_rad.astype(np.float64)), 1 / YAW_DEG)
    half = round(180 / YAW_DEG)
    yield half - (half - yaw) % (2 * half)
    yield _whole(rows.speed_mps, PER_MPS)


def _whole(values: FloatArray, per_unit: float) -> Int32Array:
    whole: Int32Array = np.rint(values.astype(np.float64) * per_unit).astype(np.int32)
    return whole


def _float32(whole: Int32Array, per_unit: int) -> Float32Array:
    return (whole / per_unit).astype(np.float32)


KEY_COLUMNS: Final = ("agent", "step", "x", "y", "yaw", "speed")
"""Folded columns of the table, next to `is_last`."""

_TURN: Final = round(360 / YAW_DEG)
_PER_UNIT_MOVED: Final = PER_MPS / (PER_METRE * 0.5)
"""Units of speed of an agent that moves a unit of place in half a second."""


def to_columns(part: TrackPart) -> dict[str, AnyArray]:
    """The columns of the table, int32, and `is_last`, bool."""
    east, north = _differences(part.x), _differences(part.y)
    columns = {
        "agent": _differences(part.agent.view(np.int32)),
        "step": _differences(part.step.view(np.int32)),
        "x": _differences(east),
        "y": _differences(north),
        "yaw": _half_turn(_differences(part.yaw)),
        "speed": part.speed - _expected(east, north),
    }
    return {**{name: column << 1 ^ column >> 31 for name, column in columns.items()}, "is_last": part.is_last}


def from_columns(columns: dict[str, AnyArray], first_step: int, last_step: int) -> TrackPart:
    """The part that `to_columns` was given."""
    agent, step, east, north, yaw, speed = (_unfolded(columns[name]) for name in KEY_COLUMNS)
    east, north = _sums(east), _sums(north)
    return TrackPart(
        first_step,
        last_step,
        agent=_sums(agent).view(np.uint32),
        step=_sums(step).view(np.uint32),
        x=_sums(east),
        y=_sums(north),
        yaw=_half_turn(_sums(yaw)),
        speed=speed + _expected(east, north),
        is_last=columns["is_last"],
    )


def _unfolded(column: Int32Array) -> Int32Array:
    whole: Int32Array = (column.view(np.uint32) >> 1).view(np.int32) ^ -(column & 1)
    return whole


def _differences(values: Int32Array) -> Int32Array:
    return np.diff(values, prepend=np.int32(0))


def _sums(values: Int32Array) -> Int32Array:
    total: Int32Array = np.cumsum(values, dtype=np.int32)
    return total


def _half_turn(yaw: Int32Array) -> Int32Array:
    """Headings in −180° (not included) … 180°."""
    turned: Int32Array = _TURN // 2 - (_TURN // 2 - yaw) % _TURN
    return turned


def _expected(east: Int32Array, north: Int32Array) -> Int32Array:
    """Speed of a displacement in half a second. Square roots are the same on every machine."""
    moved = np.sqrt(np.square(east, dtype=np.float64) + np.square(north, dtype=np.float64))
    expected: Int32Array = np.rint(moved * _PER_UNIT_MOVED).astype(np.int32)
    return expected


_SCHEMA: Final = pa.schema([*((name, pa.int32()) for name in KEY_COLUMNS), ("is_last", pa.bool_())])
_ENCODING: Final = {**dict.fromkeys(KEY_COLUMNS, "BYTE_STREAM_SPLIT"), "is_last": "RLE"}
_LEVEL: Final = 1  # Level of compression; higher ones gain 3 % and take three times as long


def part_writer(target: Any) -> pq.ParquetWriter:
    """Writes parts to a path or a stream of Arrow."""
    return pq.ParquetWriter(
        target,
        _SCHEMA,
        compression="zstd",
        compression_level=_LEVEL,
        use_dictionary=False,
        column_encoding=_ENCODING,
        store_schema=False,  # it would hold the metadata again
    )


def write_part(writer: pq.ParquetWriter, part: TrackPart) -> None:
    """Append a part as a row group."""
    columns = to_columns(part)
    table = pa.table([to_arrow(columns[name]) for name in _SCHEMA.names], schema=_SCHEMA)
    writer.write_table(table, row_group_size=max(1, len(table)))


def read_part(file: pq.ParquetFile, group: int, first_step: int, last_step: int) -> TrackPart:
    """The part that is a row group.

    Raises:
        pa.ArrowException, OSError, KeyError, ValueError: the file is damaged.
    """
    table = file.read_row_group(group, use_threads=False)
    columns = {name: from_arrow(table[name]) for name in table.column_names}
    return from_columns(columns, first_step, last_step)


def to_arrow(column: AnyArray) -> pa.Array:
    """A column of numbers or truth values, (rows,)."""
    if column.dtype == np.bool_:
        return pa.Array.from_buffers(
            pa.bool_(), len(column), [None, pa.py_buffer(np.packbits(column, bitorder="little"))]
        )
    return pa.Array.from_buffers(pa.from_numpy_dtype(column.dtype), len(column), [None, pa.py_buffer(column)])


def from_arrow(column: pa.ChunkedArray) -> AnyArray:
    """A column of numbers or truth values, (rows,), not to be written to.

    Raises:
        ValueError, TypeError: values are missing, or of another type.
    """
    whole = column.combine_chunks()
    if not pa.types.is_boolean(whole.type):
        return np.from_dlpack(whole)
    if whole.null_count:
        raise ValueError("values are missing")
    first, bits = whole.offset, np.frombuffer(whole.buffers()[1], np.uint8)
    return np.unpackbits(bits, count=first + len(whole), bitorder="little")[first:].astype(np.bool_)


@dataclass(frozen=True, eq=False)
class PackedPart:
    """A part in memory, as a file of its own."""

    first_step: int
    last_step: int
    data: Any
    """`pyarrow.Buffer`."""

    @classmethod
    def of(cls, part: TrackPart) -> Self:
        stream = pa.BufferOutputStream()
        with part_writer(stream) as writer:
            write_part(writer, part)
        return cls(part.first_step, part.last_step, stream.getvalue())

    def load(self) -> TrackPart:
        return read_part(pq.ParquetFile(pa.BufferReader(self.data)), 0, self.first_step, self.last_step)


PART_STEPS: Final = 240
"""Steps of a part, two minutes. A part also holds the first step of the next one, where its agents are going."""

STANDING_MPS: Final = 0.1
"""A slower vehicle stands; SUMO's threshold of waiting."""

TELEPORT_MPS: Final = 40.0
"""A faster agent was relocated by SUMO; the kernel does not interpolate its motion."""


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
    """Totals of each frame, from poses before rounding. All arrays (frames,)."""

    vehicles: Int64Array
    pedestrians: Int64Array
    known: Int64Array
    """Number of agents that have appeared so far."""
    standing: Int64Array
    """Vehicles that stand."""
    speed_mps: Float64Array
    """Sum over the vehicles."""

    @classmethod
    def of(cls, rows: PoseRows, is_pedestrian: BoolArray, known: int = 0) -> Self:
        """Numbers of the next frames, after frames in which `known` agents have appeared."""
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
    """Parts of the whole recording: part k begins at step k · `PART_STEPS` and ends where the next one begins."""
    first_step: int
    """The window's."""
    numbers: FrameNumbers
    """Numbers of the window's frames."""
    fastest_mps: float
    """Upper bound of speed, and of displacement over time, of moving agents."""

    @classmethod
    def of(cls, rows: PoseRows, is_pedestrian: BoolArray, step_s: float) -> Self:
        parts = tuple(_parts(rows, 0))
        return cls(_packed(parts), 0, FrameNumbers.of(rows, is_pedestrian), _fastest_mps(parts, step_s))

    @property
    def frames(self) -> int:
        return len(self.numbers.vehicles)

    @property
    def starts(self) -> tuple[int, ...]:
        """The first step of each part."""
        return tuple(part.first_step for part in self.parts)

    def between(self, first: int, end: int) -> "AgentTracks":
        """The window's frames from `first` up to but not `end`."""
        return replace(self, first_step=self.first_step + first, numbers=self.numbers.between(first, end))

    def followed_by(self, rows: PoseRows, is_pedestrian: BoolArray, step_s: float) -> "AgentTracks":
        """The tracks with further frames appended; the window must be the whole recording."""
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
        columns = (np.concatenate([getattr(rows, name) for rows in pieces]) for name in ("agent", *POSE_COLUMNS))
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
