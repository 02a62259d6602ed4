"""Key frames of some steps of a recording, rounded to whole units.

A key frame is an agent's pose at a step. Poses that equal those before and after are left out, so an agent that stands
needs two key frames, however long it stands. Rounding depends on nothing but the pose itself, so a recording that is
extended or recorded in other parts holds the same poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, FloatArray, Int32Array, UInt32Array
from pavetwin.traffic.pose_rows import PoseRows

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
    """Of the recording."""
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
        """As the columns of `PoseRows`: x, y, yaw_rad, speed_mps."""
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
