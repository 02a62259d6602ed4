"""Defects within others: a pothole in a network of cracks.

Outlines stay disjoint, so that each place belongs to one label: where the pothole lies, and `APART_M` around it, the
network is lost. Its outline has a notch there, which opens to the network's border: an outline has no holes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Point, Polygon
from shapely.affinity import affine_transform

from pavetwin.arrays import Float64Array
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.shapes import turned

DEPTH: Final = (0.35, 1.3)
"""From the host's outline to the middle of what lies in it, × half the length of that. Ours."""

MOUTH_M: Final = 0.36
"""Width of the notch where it opens. The closing of a network's label would bridge one of less than 30 cm."""

BEYOND_M: Final = 0.6
"""How far the notch reaches beyond the host's outline."""

SPARE_M: Final = 0.015
"""The notch is wider by this than what the label rule adds to the host, and than the distance of outlines."""

LEAST_LEFT: Final = 0.5
"""Share of its area that a host keeps."""

LEAST_AROUND: Final = 0.55
"""Of the directions from its middle, in which a defect within another has that one beside it."""

REACH_M: Final = 0.35
"""Beside it is what lies within this distance of its outline."""

_DIRECTIONS: Final = 36
_ROUNDED_M: Final = 0.001


@dataclass(frozen=True, eq=False)
class Host:
    """A placed defect in which others may lie."""

    shape: Heightfield
    centre: Point
    yaw_rad: float

    def notched(self, outline: Polygon, apart_m: float) -> "Notched | None":
        """What is left of it where another outline lies in it (world frame); None where too little is left, or where it
        is not around the other one."""
        own = _own(outline, self.centre, self.yaw_rad)
        whole = self.shape.outline
        middle = own.centroid
        edge = whole.exterior.interpolate(whole.exterior.project(middle))
        away = np.array([edge.x - middle.x, edge.y - middle.y])
        if not whole.contains(middle) or not np.any(away):
            return None
        out = Point(*(np.array([edge.x, edge.y]) + away / np.hypot(*away) * BEYOND_M))
        room = own.buffer(apart_m + self.shape.marking.margin_m + SPARE_M, quad_segs=4)
        mouth = LineString([middle, out]).buffer(MOUTH_M / 2, cap_style="flat")
        notch = shapely.simplify(shapely.union(room, mouth), 2 * _ROUNDED_M)
        if not isinstance(notch, Polygon) or whole.difference(notch).area < LEAST_LEFT * whole.area:
            return None
        ring = np.round(shapely.get_coordinates(notch.exterior)[:-1] / _ROUNDED_M) * _ROUNDED_M
        cut = tuple((round(x, 3), round(y, 3)) for x, y in ring.tolist())
        left = self.shape.without(np.array(cut))
        if not left.mask.any() or left.outline.area < LEAST_LEFT * whole.area:
            return None
        if left.outline.distance(own) < apart_m or _around(left.outline, own) < LEAST_AROUND:
            return None
        return Notched(left, cut)


@dataclass(frozen=True, eq=False)
class Notched:
    """What is left of a host."""

    shape: Heightfield
    ring: tuple[tuple[float, float], ...]
    """The notch, in the host's own frame [m]."""


def places_in(host: Host, length_m: float, rng: np.random.Generator, count: int) -> Iterator[tuple[float, float]]:
    """World points (x, y) at which the middle of a defect of a length may lie in a host: near its border."""
    whole = host.shape.outline
    for at in rng.random(count).tolist():
        edge = whole.exterior.interpolate(at, normalized=True)
        depth = float(rng.uniform(*DEPTH)) * length_m / 2
        ahead = whole.exterior.interpolate((at + 0.02) % 1, normalized=True)
        back = whole.exterior.interpolate((at - 0.02) % 1, normalized=True)
        along = np.array([ahead.x - back.x, ahead.y - back.y])
        inward = np.array([-along[1], along[0]]) / max(1e-9, float(np.hypot(*along)))
        inward *= 1.0 if whole.exterior.is_ccw else -1.0
        own = np.array([edge.x, edge.y]) + depth * inward
        x, y = turned(own[None], host.yaw_rad)[0] + (host.centre.x, host.centre.y)
        yield float(x), float(y)


def _own(outline: Polygon, centre: Point, yaw_rad: float) -> Polygon:
    """An outline of the world in the frame of a defect."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    x, y = -(cos * centre.x + sin * centre.y), sin * centre.x - cos * centre.y
    return affine_transform(outline, [cos, sin, -sin, cos, x, y])


def _around(host: Polygon, within: Polygon) -> float:
    """Share of the directions from the middle of an outline in which a host lies beside it."""
    middle = np.array(within.centroid.coords[0])
    angles = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    ends: Float64Array = middle + 9.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    rays = shapely.linestrings(np.stack([np.broadcast_to(middle, ends.shape), ends], axis=1))
    beside = shapely.intersection(shapely.difference(rays, within), within.buffer(REACH_M, quad_segs=4))
    return float(shapely.intersects(beside, host).mean())
