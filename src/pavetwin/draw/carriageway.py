"""The lines between lanes, as a map shows them."""

import numpy as np
import shapely
from shapely import Geometry, LineString

from pavetwin.arrays import Float64Array
from pavetwin.world.model import LaneKind, World

_KERB_M = 0.7
"""Lines closer to the kerb than this are no lane lines."""


def lane_lines(world: World) -> list[Float64Array]:
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
