"""What a mission left behind, read for a picture: outcomes of defects, waits, displacements, revisits, windows.

Everything is in the world frame: metres, radians, seconds. Nothing here draws.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import hypot

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, UInt8Array
from pavetwin.mission.environment import window_m
from pavetwin.mission.fly import MissionResult
from pavetwin.twin import Mode
from pavetwin.uav import find_camera

Place = tuple[float, float]

SAME_PLACE_M = 1.5
"""Stays closer together than this are one mark."""

SAME_WINDOW_M = 0.5

STILL_MPS = 0.2
"""Below this speed the UAV stands over a place."""

LEAD_S = 4.0
"""An animation begins this long before what it is to show."""

NUMBER = {mode: index for index, mode in enumerate(Mode)}
"""Of a mode in the track."""


class Outcome(StrEnum):
    """What became of a defect of an inspected segment."""

    CONFIRMED = "confirmed"
    RECOVERED = "recovered"
    """Confirmed first on a revisit."""
    MISSED = "missed"


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


def outcomes(result: MissionResult) -> dict[int, Outcome]:
    """Of every defect of the inspected segments, and of those confirmed elsewhere in passing."""
    visited = {row.segment for row in result.rows}
    found = {}
    for defect in result.environment.defects:
        confirmation = result.memory.confirmed.get(defect.id)
        if confirmation is not None:
            found[defect.id] = Outcome.RECOVERED if confirmation.on_revisit else Outcome.CONFIRMED
        elif defect.segment in visited:
            found[defect.id] = Outcome.MISSED
    return found


def doing(result: MissionResult) -> UInt8Array:
    """(n,) for each sample of the track, what the UAV did, by the number of its mode.

    While it stands and looks whether to wait on, the kernel has it inspect; here it waits.
    """
    mode = np.array(result.track["mode"], dtype=np.uint8)
    looks = (mode == NUMBER[Mode.INSPECT]) & (result.track["speed_mps"] < STILL_MPS)
    looks[:-1] &= mode[1:] == NUMBER[Mode.WAIT]
    looks[-1:] = False
    mode[looks] = NUMBER[Mode.WAIT]
    return mode


def waits(result: MissionResult) -> list[HoverStop]:
    """Where the policy waited, and for how long in all."""
    return _stays(result, doing(result) == NUMBER[Mode.WAIT])


def revisits(result: MissionResult) -> list[HoverStop]:
    """The places that were visited again, and how long the UAV stood and looked there."""
    stands = result.track["speed_mps"] < STILL_MPS
    return _stays(result, (result.track["mode"] == NUMBER[Mode.REVISIT]) & stands & inspecting(result))


def _stays(result: MissionResult, chosen: BoolArray) -> list[HoverStop]:
    track = result.track
    lasts = np.diff(track["t_s"], append=track["t_s"][-1:])
    stays: list[HoverStop] = []
    for index in np.flatnonzero(chosen):
        x, y, seconds = float(track["x_m"][index]), float(track["y_m"][index]), float(lasts[index])
        for number, stay in enumerate(stays):
            if hypot(stay.position[0] - x, stay.position[1] - y) < SAME_PLACE_M:
                stays[number] = HoverStop(stay.position, stay.seconds + seconds)
                break
        else:
            stays.append(HoverStop((x, y), seconds))
    return [stay for stay in stays if stay.seconds > 0]


def displacements(result: MissionResult) -> list[Displacement]:
    """Each displacement, from where it set out to the farthest place it came to."""
    steps = []
    for rows in runs(result.track["mode"] == NUMBER[Mode.DISPLACE]):
        x, y = result.track["x_m"][rows], result.track["y_m"][rows]
        away = np.hypot(x - x[0], y - y[0])
        far = int(np.argmax(away))
        if away[far] > STILL_MPS:
            steps.append(Displacement((float(x[0]), float(y[0])), (float(x[far]), float(y[far]))))
    return steps


def runs(chosen: BoolArray) -> list[slice]:
    """The unbroken stretches of true values, as slices."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [slice(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]


def inspecting(result: MissionResult) -> BoolArray:
    """(n,) for each sample of the track, whether the camera was looking at a segment."""
    return np.asarray(np.isfinite(result.track["visibility"]), dtype=np.bool_)


def avoiding(result: MissionResult) -> BoolArray:
    """(n,) for each sample of the track, whether the UAV gave way to another aircraft."""
    return np.asarray(result.track["mode"] == NUMBER[Mode.AVOID], dtype=np.bool_)


def rectangles(
    x_m: Float64Array, y_m: Float64Array, yaw_rad: Float64Array, across_m: float, along_m: float
) -> Float64Array:
    """(n, 4, 2) corners of rectangles on the ground, `along_m` in the direction of the yaw and `across_m` beside it."""
    forward = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
    centre = np.stack([x_m, y_m], axis=-1)
    signs = ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))
    corners = [centre + a * along_m * forward + b * across_m * left for a, b in signs]
    return np.asarray(np.stack(corners, axis=1))


def windows(result: MissionResult, segment: int | None = None) -> tuple[Float64Array, Float64Array]:
    """The inspection windows that were captured: corners (n, 4, 2) and visibility (n,).

    Captures that repeat the one before them (the UAV stood) are left out, the one that saw most excepted.

    Args:
        segment: only those of this segment, by its index.
    """
    captures = result.captures
    chosen = np.arange(len(captures["t_s"]))
    if segment is not None:
        chosen = chosen[captures["segment"] == segment]
    kept: list[int] = []
    x, y = captures["x_m"], captures["y_m"]
    for index in chosen:
        if kept and hypot(x[index] - x[kept[-1]], y[index] - y[kept[-1]]) < SAME_WINDOW_M:
            if captures["visibility"][index] > captures["visibility"][kept[-1]]:
                kept[-1] = int(index)
        else:
            kept.append(int(index))
    at = np.array(kept, dtype=np.intp)
    across, along = window_m(result.settings)
    corners = rectangles(captures["x_m"][at], captures["y_m"][at], captures["yaw_rad"][at], across, along)
    return corners, captures["visibility"][at]


def footprint_m(result: MissionResult) -> tuple[float, float]:
    """The camera's whole footprint (across the track, along it) in metres."""
    return find_camera(result.settings.camera.model).footprint_m(result.settings.altitude_m)


def telling_segments(results: Sequence[MissionResult]) -> list[str]:
    """The inspected segments, those most worth a closer look first: most occlusions, longest waits, longest."""
    scores: dict[str, tuple[float, float, float]] = {}
    for row in (row for result in results for row in result.rows):
        occlusions, waited, length = scores.get(row.segment, (0.0, 0.0, row.length_m))
        scores[row.segment] = (occlusions + row.occlusions, waited + row.wait_s + 5 * row.revisits, length)
    return sorted(scores, key=lambda segment: scores[segment], reverse=True)


def telling_moment_s(result: MissionResult) -> float:
    """When an animation should begin: shortly before the first reaction of the policy, else the first occlusion."""
    track = result.track
    if result.actions:
        event_s = result.actions[0].time_s
    else:
        seen = inspecting(result)
        low = seen & (np.nan_to_num(track["visibility"], nan=1.0) < result.settings.visibility.threshold)
        which = np.flatnonzero(low) if low.any() else np.flatnonzero(seen)
        event_s = float(track["t_s"][which[0]]) if len(which) else 0.0
    return max(0.0, event_s - LEAD_S)
