"""A single crack: a line that wanders along, across or obliquely to the street, millimetres to centimetres open."""

import math

import numpy as np
from shapely import LineString, Polygon

from pavetwin.config.base import Settings
from pavetwin.defects.outlines import Points, Range, between, turned
from pavetwin.defects.registry import register
from pavetwin.world.model import DefectClass

STEP = 0.12
"""Distance between the points of the line [m]."""

WANDER, PULL_BACK = 0.22, 0.25
"""Heading of the line: standard deviation of its change a step [rad], and the share by which it returns a step."""

DIRECTIONS = ((0.0, 0.12), (math.pi / 2, 0.12), (math.pi / 4, 0.25), (-math.pi / 4, 0.25))
"""Longitudinal, transverse, oblique (two ways): angle to the street and its standard deviation [rad]."""

DIRECTION_WEIGHTS = (0.4, 0.35, 0.125, 0.125)


class SingleCrackParameters(Settings):
    length_m: Range = (0.5, 6.0)
    """Along its chord."""
    width_m: Range = (0.002, 0.08)
    """At its widest; drawn evenly in the logarithm, since narrow cracks are the common ones."""


def single_crack(rng: np.random.Generator, parameters: SingleCrackParameters | None = None) -> Polygon:
    """The outline of a crack around the middle of its line; x runs along the street."""
    parameters = parameters or SingleCrackParameters()
    length = between(rng, parameters.length_m)
    width = math.exp(between(rng, (math.log(parameters.width_m[0]), math.log(parameters.width_m[1]))))
    direction = int(rng.choice(len(DIRECTIONS), p=DIRECTION_WEIGHTS))
    angle = DIRECTIONS[direction][0] + float(rng.normal(0.0, DIRECTIONS[direction][1]))
    line = turned(_line(rng, length), angle)
    half = _half_widths(rng, len(line), width)
    normals = _normals(line)
    polygon = Polygon(np.concatenate([line + normals * half[:, None], (line - normals * half[:, None])[::-1]]))
    if not polygon.is_valid:  # the line turned sharper than it is wide
        polygon = LineString(line).buffer(float(half.mean()), cap_style="flat", join_style="mitre")
    return Polygon(polygon.exterior)


def _line(rng: np.random.Generator, length_m: float) -> Points:
    """Points (n, 2) of a line whose chord lies on x, `length_m` long, its middle point at the origin."""
    count = max(6, math.ceil(length_m / STEP))
    heading = np.zeros(count)
    for index in range(1, count):
        heading[index] = (1 - PULL_BACK) * heading[index - 1] + float(rng.normal(0.0, WANDER))
    steps = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    line = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    chord = line[-1]
    line = turned(line, -math.atan2(chord[1], chord[0])) * (length_m / math.hypot(*chord))
    return np.asarray(line - line[len(line) // 2], dtype=np.float64)


def _half_widths(rng: np.random.Generator, count: int, width_m: float) -> Points:
    """Half the opening along the line: it varies, is nowhere wider than asked, and closes towards both ends."""
    share = np.linspace(0.0, 1.0, count)
    ends = np.minimum(1.0, 6.0 * np.minimum(share, 1 - share) + 0.25)
    opening = np.clip(0.75 + 0.25 * np.sin(share * float(rng.uniform(4, 15)) + float(rng.uniform(0, 6))), 0.4, 1.0)
    profile = ends * opening
    return np.asarray(width_m / 2 * profile / profile.max(), dtype=np.float64)


def _normals(line: Points) -> Points:
    tangent = np.gradient(line, axis=0)
    tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
    return np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)


register(DefectClass.SINGLE_CRACK, single_crack, weight=0.5)
