"""A part of a recording as the columns of a table that compresses well: differences, as small natural numbers.

Agent, step, heading: by how much a key frame differs from the one before. Place: by how much that difference, the
way moved, differs from the one before; nothing, of who moves evenly. Speed: by how much it differs from half the way
moved, which it is where that took a step of half a second. The first key frame of an agent is no exception.
Differences wrap around at 32 bits, as their sums do. Whole numbers are folded: 0, −1, 1, −2, 2 … are 0, 1, 2, 3, 4 …
"""

from typing import Final

import numpy as np

from pavetwin.arrays import AnyArray, Int32Array
from pavetwin.traffic.track_part import PER_METRE, PER_MPS, YAW_DEG, TrackPart

COLUMNS: Final = ("agent", "step", "x", "y", "yaw", "speed")
"""Of the table, folded; beside them `is_last`."""

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
    agent, step, east, north, yaw, speed = (_unfolded(columns[name]) for name in COLUMNS)
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
    """In −180° (not included) … 180°."""
    turned: Int32Array = _TURN // 2 - (_TURN // 2 - yaw) % _TURN
    return turned


def _expected(east: Int32Array, north: Int32Array) -> Int32Array:
    """The speed of who moved so far in half a second. Square roots are the same on every machine."""
    moved = np.sqrt(np.square(east, dtype=np.float64) + np.square(north, dtype=np.float64))
    expected: Int32Array = np.rint(moved * _PER_UNIT_MOVED).astype(np.int32)
    return expected
