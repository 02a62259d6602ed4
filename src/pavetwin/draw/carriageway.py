"""The carriageway as a map shows it: segments, and of each junction the part between its arms; and its lane lines."""

import numpy as np
import shapely
from shapely import Geometry, LineString

from pavetwin.draw.shapes import Floats
from pavetwin.world.model import LaneKind, World

_TOUCH_M = 0.4
"""A segment that ends within this of a junction is one of its arms."""

_ROUND_M = 2.2
"""Kerbs at junctions are rounded with this radius, and gaps of twice as much are closed."""

_KERB_M = 0.7
"""Lines closer to the kerb than this are no lane lines."""


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


def lane_lines(world: World) -> list[Floats]:
    """The lines between lanes: of every driving edge between its own lanes, and between the directions of a street."""
    driven = [lane for lane in world.lanes if lane.kind is LaneKind.DRIVING]
    lanes: dict[str, list[tuple[int, LineString, float]]] = {}
    for lane in driven:
        number = lane.id.rpartition("_")[2]
        lanes.setdefault(lane.edge, []).append((int(number) if number.isdigit() else 0, lane.centre_line, lane.width_m))
    two_way = {segment.edges[0] for segment in world.segments if len(segment.edges) > 1}
    lines: list[Geometry] = []
    for edge, of_edge in lanes.items():
        ordered = sorted(of_edge, key=lambda item: item[0])
        inner = ordered if edge in two_way else ordered[:-1]
        lines += [line.offset_curve(width / 2) for _, line, width in inner]
    if not lines:
        return []
    surface = shapely.union_all([shapely.buffer(segment.polygon, -_KERB_M) for segment in world.segments])
    inside = shapely.intersection(np.array(lines, dtype=object), surface)
    parts = shapely.get_parts(inside)
    return [shapely.get_coordinates(part) for part in parts if isinstance(part, LineString) and part.length > 2.0]
