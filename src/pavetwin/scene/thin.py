"""Wires and twigs: round things too thin for a shadow map, as segments, and the strips of ground that they shade.

A segment is a row (7,): both ends x, y, z in the world frame and its radius, metres. A shadow map of 1 to 3 cm a texel
would cut such shadows into dots; so the strip of ground between the sun's rays past a segment is found here, and a
renderer computes in each of its pixels which share of the sun's disc the segment hides.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array

STEP_M: Final = 0.25
"""Strips follow the height of the ground in steps of this length."""

FARTHEST_M: Final = 60.0
"""Shadows farther from their segments are left out: the sun's disc has blurred them away."""

LEVEL_M: Final = 0.004
"""Ground that differs by less is level."""


def shaded_strips(
    segments: Float64Array, to_sun: Float64Array, heights: Callable[[npt.ArrayLike], Float64Array]
) -> Float64Array:
    """The strips of level ground that segments shade.

    Args:
        segments: (n, 7).
        to_sun: (3,) unit vector, above the horizon.
        heights: of the ground [m] at points (m, 2) of the world.

    Returns:
        (m, 8): the part of a segment that shades one level strip (both ends, radius), and the height of that ground.
    """
    a, b = segments[:, :3], segments[:, 3:6]
    # A segment is cut where its shadow would be STEP_M long on ground at height 0.
    flat = (b - a)[:, :2] - to_sun[:2] / to_sun[2] * (b - a)[:, 2:]
    near = np.maximum(a[:, 2], b[:, 2]) / to_sun[2] < FARTHEST_M
    count = np.where(near, np.maximum(np.ceil(np.hypot(*flat.T) / STEP_M), 1), 0).astype(int)
    if not count.sum():
        return np.zeros((0, 8))
    owner = np.repeat(np.arange(len(segments)), count)
    first = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = (first + 0.5) / count[owner]
    middle = a[owner] + share[:, None] * (b - a)[owner]
    ground = np.zeros(len(owner))
    for _ in range(2):
        ground = heights(middle[:, :2] - to_sun[:2] / to_sun[2] * (middle[:, 2] - ground)[:, None])
    # Neighbours on one level make one strip.
    starts = np.flatnonzero((first == 0) | (np.abs(np.diff(ground, prepend=np.inf)) > LEVEL_M))
    ends = np.append(starts[1:], len(owner)) - 1
    mine, low, high = owner[starts], first[starts], first[ends] + 1
    step = (b - a)[mine] / count[mine][:, None]
    strips = [a[mine] + low[:, None] * step, a[mine] + high[:, None] * step, segments[mine, 6:], ground[starts, None]]
    return np.concatenate(strips, axis=1)
