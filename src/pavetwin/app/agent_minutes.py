"""The agents of a trace by the minute, in the form that the browser plays.

A minute holds every agent's pose at each step of the trace from its first moment to its last, both included. An agent
that is there at successive steps, between which the trace moves it, makes one run. Between two steps the browser
interpolates as the kernel does, linearly and with the shorter turn; after the last step of a run the agent stays until
the next step and is gone then.

The bytes of a minute, little-endian, each column whole before the next:

| column | type | |
|---|---|---|
| magic, runs, poses | 3 × uint32 | `PTA1`, R and N |
| agent, x, y | 3 × R × uint32, int32, int32 | number; first position in centimetres of the world frame |
| first, count | 2 × R × uint16 | step within the minute, number of poses |
| yaw | R × int16 | first one, in 10⁻⁴ rad |
| dx, dy, dyaw | 3 × N × int16 | from the pose before, 0 for the first of a run |
"""

from collections.abc import Iterator
from math import ceil, pi
from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin._core import Trace
from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.traffic.tracks import TELEPORT_MPS

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns

MAGIC: Final = int.from_bytes(b"PTA1", "little")

MINUTE_S: Final = 60.0

_PER_M: Final = 100.0
"""Centimetres."""

_PER_RAD: Final = 1e4

_STRAIGHT_M: Final = 0.02
"""An agent is moved between two steps where its velocity leads this close to where it is next."""


def minutes(trace: Trace, step_s: float, until_s: float) -> Iterator[bytes]:
    """The minutes of a trace from its beginning.

    Args:
        step_s: between two steps of the trace; a minute is a whole number of steps.
        until_s: the last moment that is played.
    """
    for number in range(max(1, ceil(until_s / MINUTE_S - 1e-9))):
        yield minute(trace, step_s, number)


def minute(trace: Trace, step_s: float, number: int) -> bytes:
    """One minute of a trace, or what there is of it."""
    steps = round(MINUTE_S / step_s)
    first, last = number * steps, int(trace.duration_s / step_s + 1e-6)
    frames = [trace.agents_at(step * step_s) for step in range(first, min(first + steps, last) + 1)]
    return _encoded(frames, step_s)


def _encoded(frames: list["PoseColumns"], step_s: float) -> bytes:
    counts = [len(frame["agent"]) for frame in frames]
    step: Int64Array = np.repeat(np.arange(len(frames)), counts)
    columns = {
        name: np.concatenate([np.asarray(frame[name], dtype=np.float64) for frame in frames])
        for name in ("agent", "x_m", "y_m", "yaw_rad", "east_mps", "north_mps")
    }
    order = np.lexsort((step, columns["agent"]))
    step, columns = step[order], {name: values[order] for name, values in columns.items()}
    starts = _starts(step, columns, step_s)
    first = np.flatnonzero(starts)
    lengths = np.diff(np.append(first, len(step)))
    x, y = (np.rint(columns[name] * _PER_M).astype(np.int64) for name in ("x_m", "y_m"))
    yaw = np.rint(columns["yaw_rad"] * _PER_RAD).astype(np.int64)
    turn = round(2 * pi * _PER_RAD)
    turned = (_differences(yaw, starts) + turn // 2) % turn - turn // 2
    parts = [
        np.array([MAGIC, len(first), len(step)], dtype="<u4"),
        columns["agent"][first].astype("<u4"),
        *(values[first].astype("<i4") for values in (x, y)),
        step[first].astype("<u2"),
        lengths.astype("<u2"),
        np.clip(yaw[first], -32767, 32767).astype("<i2"),
        *(_differences(values, starts).astype("<i2") for values in (x, y)),
        np.where(starts, 0, turned).astype("<i2"),
    ]
    return b"".join(part.tobytes() for part in parts)


def _starts(step: Int64Array, columns: dict[str, Float64Array], step_s: float) -> BoolArray:
    """(n,) whether a pose begins a run: another agent, a gap, or a step over which the trace does not move it.

    The trace tells the velocity towards the next pose where it moves an agent there, and that of its heading elsewhere.
    """
    if not len(step):
        return np.zeros(0, dtype=np.bool_)
    led = [
        columns[place][:-1] + columns[speed][:-1] * step_s - columns[place][1:]
        for place, speed in (("x_m", "east_mps"), ("y_m", "north_mps"))
    ]
    moved = np.hypot(np.diff(columns["x_m"]), np.diff(columns["y_m"]))
    linked = (
        (np.diff(columns["agent"]) == 0)
        & (np.diff(step) == 1)
        & (np.hypot(*led) < _STRAIGHT_M)
        & (moved <= 2 * TELEPORT_MPS * step_s)
    )
    return np.concatenate([[True], ~linked])


def _differences(values: Int64Array, starts: BoolArray) -> Int64Array:
    """(n,) from the value before; 0 where a run begins."""
    return np.where(starts, 0, np.diff(values, prepend=values[:1]))
