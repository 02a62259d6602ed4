"""Every agent's pose in consecutive frames, a row each."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, Int64Array, UInt32Array

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
