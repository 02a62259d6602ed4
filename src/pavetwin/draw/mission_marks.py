"""Parts of a mission's result that images show: outcomes of defects, captured windows, notable segments.

Everything is in the world frame: metres, radians, seconds. Nothing here draws.
"""

from collections.abc import Sequence
from enum import StrEnum
from math import hypot

import numpy as np
from numpy.typing import ArrayLike

from pavetwin.arrays import Float64Array
from pavetwin.mission.environment import window_m
from pavetwin.mission.inspected_defects import MissReason
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline
from pavetwin.uav import camera_of

SAME_WINDOW_M = 0.5

LEAD_S = 4.0  # An animation begins this long before the event that it shows


class DefectOutcome(StrEnum):
    """Outcome of a defect of an inspected segment, as legends state it."""

    CONFIRMED = "found"
    RECOVERED = "found on return"
    """Confirmed first on a revisit."""
    MISSED = "missed"
    BEHIND_PARKED = "behind parked vehicle"
    """Missed: under or behind a parked vehicle, hidden permanently."""


def outcomes(result: MissionResult) -> dict[int, DefectOutcome]:
    """Outcome of every defect of the inspected segments, and of those confirmed elsewhere in passing."""
    visited = {row.segment for row in result.rows}
    missed = {each.defect.id: each.reason for each in result.inspected_defects if not each.is_found}
    found = {}
    for defect in result.environment.defects:
        confirmation = result.memory.confirmed.get(defect.id)
        if confirmation is not None:
            found[defect.id] = DefectOutcome.RECOVERED if confirmation.on_revisit else DefectOutcome.CONFIRMED
        elif defect.segment in visited:
            parked = missed[defect.id] is MissReason.HIDDEN_BY_PARKED_VEHICLES
            found[defect.id] = DefectOutcome.BEHIND_PARKED if parked else DefectOutcome.MISSED
    return found


def rectangles(
    x_m: ArrayLike, y_m: ArrayLike, yaw_rad: ArrayLike, across_m: ArrayLike, along_m: ArrayLike
) -> Float64Array:
    """(..., 4, 2) corners of rectangles on the ground, `along_m` in the direction of the yaw and `across_m` across it.

    The arguments are (...), or one number for all.
    """
    forward = np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=-1)
    left = np.stack([-forward[..., 1], forward[..., 0]], axis=-1)
    centre = np.stack([x_m, y_m], axis=-1)
    along, across = (np.asarray(size, dtype=np.float64)[..., None] for size in (along_m, across_m))
    signs = ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))
    return np.stack([centre + a * along * forward + b * across * left for a, b in signs], axis=-2)


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
    x, y, visibility = captures["x_m"], captures["y_m"], captures["visibility"]
    for index in chosen.tolist():
        if not kept or hypot(x[index] - x[kept[-1]], y[index] - y[kept[-1]]) >= SAME_WINDOW_M:
            kept.append(index)
        elif visibility[index] > visibility[kept[-1]]:
            kept[-1] = index
    at = np.array(kept, dtype=np.intp)
    return rectangles(x[at], y[at], captures["yaw_rad"][at], *window_m(result.settings)), visibility[at]


def footprint_m(result: MissionResult) -> tuple[float, float]:
    """The camera's whole footprint (across the track, along it) in metres."""
    return camera_of(result.settings).footprint_m(result.settings.altitude_m)


def notable_segments(results: Sequence[MissionResult]) -> list[str]:
    """The inspected segments, those most worth a closer look first: most occlusions, longest waits, longest."""
    scores: dict[str, tuple[float, float, float]] = {}
    for row in (row for result in results for row in result.rows):
        occlusions, waited, length = scores.get(row.segment, (0.0, 0.0, row.length_m))
        scores[row.segment] = (occlusions + row.occlusions, waited + row.wait_s + 5 * row.revisits, length)
    return sorted(scores, key=lambda segment: scores[segment], reverse=True)


def why_notable(results: Sequence[MissionResult], segment: str) -> str:
    """In what a segment that `notable_segments` names first exceeds the others."""
    rows = [row for result in results for row in result.rows]
    of_it = [row for row in rows if row.segment == segment]
    if any(row.occlusions for row in of_it):
        return "hidden most often"
    return "waited over longest" if any(row.wait_s or row.revisits for row in of_it) else "the longest"


def start_of_interest_s(timeline: Timeline) -> float:
    """When an animation should begin: shortly before the first reaction of the policy, else the first occlusion."""
    return max(0.0, timeline.first_reaction_s() - LEAD_S)
