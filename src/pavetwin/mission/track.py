"""Activities in the track of a mission: at each sample, and the waits, displacements and revisits.

World frame: metres, radians, seconds.
"""

from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np

from pavetwin._core import MODES as MODE_NAMES
from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.twin import Mode, Place

if TYPE_CHECKING:
    from pavetwin._core import TrackColumns

LATE_S = 1e-9
"""Tolerance of sample times, which are sums of time steps."""

SAME_PLACE_M = 1.5
"""Stops closer together than this are one."""

STILL_MPS = 0.2
"""Speed below which the UAV stands over a place."""

MODES = tuple(Mode(name) for name in MODE_NAMES)
"""Modes by their numbers in the kernel's track."""

MODE_NUMBER = {mode: number for number, mode in enumerate(MODES)}
"""Numbers of the modes in the track."""


@dataclass(frozen=True, slots=True)
class HoverStop:
    """A place where the UAV stood for a while."""

    position: Place
    seconds: float


@dataclass(frozen=True, slots=True)
class Displacement:
    """A displacement: from the route to the place aside."""

    start: Place
    end: Place


def activity(track: "TrackColumns") -> UInt8Array:
    """(n,) number of the mode at each sample.

    A look between two waits counts as waiting; for the kernel it is an inspection.
    """
    mode = np.array(track["mode"], dtype=np.uint8)
    looks = (mode == MODE_NUMBER[Mode.INSPECT]) & (track["speed_mps"] < STILL_MPS)
    looks[:-1] &= mode[1:] == MODE_NUMBER[Mode.WAIT]
    looks[-1:] = False
    mode[looks] = MODE_NUMBER[Mode.WAIT]
    return mode


def inspecting(track: "TrackColumns") -> BoolArray:
    """(n,) for each sample, True if the camera was looking at a segment."""
    return np.asarray(np.isfinite(track["visibility"]), dtype=np.bool_)


def avoiding(track: "TrackColumns") -> BoolArray:
    """(n,) for each sample, True if the UAV gave way to another aircraft."""
    return np.asarray(track["mode"] == MODE_NUMBER[Mode.AVOID], dtype=np.bool_)


def waits(track: "TrackColumns") -> list[HoverStop]:
    """Places where the policy waited, with the total time at each."""
    return _stops(track, activity(track) == MODE_NUMBER[Mode.WAIT])


def revisits(track: "TrackColumns") -> list[HoverStop]:
    """Revisited places, with the time that the UAV stood and looked there."""
    stands = track["speed_mps"] < STILL_MPS
    return _stops(track, (track["mode"] == MODE_NUMBER[Mode.REVISIT]) & stands & inspecting(track))


def _stops(track: "TrackColumns", chosen: BoolArray) -> list[HoverStop]:
    lasts, places = np.diff(track["t_s"], append=track["t_s"][-1:]), np.column_stack([track["x_m"], track["y_m"]])
    rows, moves = np.flatnonzero(chosen), np.any(np.diff(places, axis=0, prepend=np.nan) != 0, axis=1)
    begins = np.flatnonzero((np.diff(rows, prepend=-2) > 1) | moves[rows])  # of rows without a break at one place
    stops: list[HoverStop] = []
    for row, seconds in zip(rows[begins], np.add.reduceat(lasts[rows], begins), strict=True):
        x, y = float(track["x_m"][row]), float(track["y_m"][row])
        for number, stop in enumerate(stops):
            if hypot(stop.position[0] - x, stop.position[1] - y) < SAME_PLACE_M:
                stops[number] = HoverStop(stop.position, stop.seconds + float(seconds))
                break
        else:
            stops.append(HoverStop((x, y), float(seconds)))
    return [stop for stop in stops if stop.seconds > 0]


def displacements(track: "TrackColumns") -> list[Displacement]:
    """All displacements, from their start to the farthest place."""
    steps = []
    for rows in runs(track["mode"] == MODE_NUMBER[Mode.DISPLACE]):
        x, y = track["x_m"][rows], track["y_m"][rows]
        away = np.hypot(x - x[0], y - y[0])
        far = int(np.argmax(away))
        if away[far] > STILL_MPS:
            steps.append(Displacement((float(x[0]), float(y[0])), (float(x[far]), float(y[far]))))
    return steps


def runs(chosen: BoolArray) -> list[slice]:
    """Slices of consecutive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [slice(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]
