"""The carriageway as it lies there: segments, and of each junction the part between its arms."""

import numpy as np
import shapely
from shapely import Geometry

from pavetwin.world.model import World

_TOUCH_M = 0.4
"""A segment that ends within this of a junction is one of its arms."""

_ROUND_M = 2.2
"""Kerbs at junctions are rounded with this radius, and gaps of twice as much are closed."""


def carriageway(world: World) -> Geometry:
    """All segments and the driven part of all junctions, as one shape.

    SUMO's junctions hold the corners of their sidewalks too; outside the hull of its arms' ends nobody drives.
    A crossing counts as an arm, for the places where two junctions meet.
    """
    roads: list[Geometry] = [segment.polygon for segment in world.segments]
    roads += [crossing.polygon for crossing in world.crossings]
    junctions = np.array([junction.polygon for junction in world.junctions], dtype=object)
    parts = list(roads)
    if len(junctions):
        near = shapely.buffer(junctions, _TOUCH_M)
        which, arm = shapely.STRtree(roads).query(near, predicate="intersects")
        ends = shapely.intersection(np.array(roads, dtype=object)[arm], near[which])
        for index in range(len(junctions)):
            hull = shapely.convex_hull(shapely.union_all(ends[which == index]))
            parts.append(shapely.intersection(hull, near[index]))
    whole = shapely.buffer(shapely.union_all(shapely.buffer(np.array(parts, dtype=object), 0.1)), -0.1)
    rounded = shapely.buffer(shapely.buffer(whole, _ROUND_M), -_ROUND_M)
    at_junctions = shapely.intersection(rounded, shapely.union_all(shapely.buffer(junctions, 2 * _ROUND_M)))
    return shapely.union(whole, shapely.buffer(at_junctions, 0))
