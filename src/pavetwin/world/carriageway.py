"""The carriageway of a world as it is built: its segments, and of each junction the part between its arms.

It is the only definition of the road surface: scenes and maps draw it, nothing is placed on it, images measure it.
Each segment's polygon is its part of it, and densities per square metre use the area of that polygon. Junction areas
belong to no segment.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import GeometryArray

_TOUCH_M = 0.4
"""A segment that ends within this of a junction is one of its arms."""

_ROUND_M = 2.2
"""Gaps of twice as much between the arms of a junction are closed [m]."""

_CORNER_RADIUS_M = 7.0
"""Least radius of a kerb around a corner; 6 to 8 m are built where streets cross squarely (RASt 06)."""

_SPECK_M2 = 1.0
"""Smaller islands and holes have no kerb of their own."""


def carriageway(arms: Sequence[BaseGeometry], junctions: Sequence[BaseGeometry]) -> BaseGeometry:
    """The surface as one shape, metres, world frame; `World.carriageway` keeps it.

    Corners of junctions are rounded as kerbs are built. No arm reaches out of it by more than 2 cm.

    Args:
        arms: the polygons of segments and of crossings. A crossing counts as an arm for the places where two junctions
            meet.
        junctions: their polygons as SUMO has them, with the corners of sidewalks.
    """
    whole = shapely.union_all([_unrounded(arms, np.array(junctions, dtype=object))])
    return _without_specks(_with_corners(whole, junctions))


def _unrounded(arms: Sequence[BaseGeometry], junctions: GeometryArray) -> BaseGeometry:
    """All arms and the driven part of all junctions: the hull of the arms' ends excludes the corners of sidewalks."""
    parts: list[BaseGeometry] = list(arms)
    if len(junctions):
        near = shapely.buffer(junctions, _TOUCH_M)
        which, arm = STRtree(arms).query(near, predicate="intersects")
        ends = shapely.intersection(np.array(arms, dtype=object)[arm], near[which])
        for index in range(len(junctions)):
            hull = shapely.convex_hull(shapely.union_all(ends[which == index]))
            parts.append(shapely.intersection(hull, near[index]))
    whole = shapely.buffer(shapely.union_all(shapely.buffer(np.array(parts, dtype=object), 0.1)), -0.1)
    rounded = shapely.buffer(shapely.buffer(whole, _ROUND_M), -_ROUND_M)
    at_junctions = shapely.intersection(rounded, shapely.union_all(shapely.buffer(junctions, 2 * _ROUND_M)))
    return shapely.union(whole, shapely.buffer(at_junctions, 0))


def _with_corners(road: BaseGeometry, junctions: Sequence[BaseGeometry]) -> BaseGeometry:
    """The carriageway with rounded corners at junctions, as kerbs are built."""
    if not junctions:
        return road
    closed = road.buffer(_CORNER_RADIUS_M, quad_segs=8).buffer(-_CORNER_RADIUS_M, quad_segs=8)
    added = shapely.get_parts(shapely.difference(closed, road))
    corners = np.unique(STRtree(junctions).query(added, "dwithin", distance=1.0)[0])
    return shapely.union_all([road, *shapely.buffer(added[corners], 0.005)])


def _without_specks(road: BaseGeometry) -> BaseGeometry:
    """Without islands and holes too small for a kerb of their own, and without near-duplicate points."""
    parts = []
    for part in shapely.get_parts(shapely.simplify(road, 0.01)):
        if isinstance(part, Polygon) and part.area >= _SPECK_M2:
            rings = [ring for ring in part.interiors if Polygon(ring).area >= _SPECK_M2]
            parts.append(Polygon(part.exterior, rings))
    return shapely.make_valid(shapely.union_all(parts))
