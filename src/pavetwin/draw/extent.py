"""Extent, attribution and derived surfaces of maps of a world; imports no drawing library."""

from typing import Final

import numpy as np
import shapely
from shapely import Geometry, LineString
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.world.ground import Bounds
from pavetwin.world.model import LaneKind, World
from pavetwin.world.store import attribution, load_record

MARGIN_M: Final = 12.0

_KERB_M: Final = 0.7  # Lines closer to the kerb than this are not lane lines


def world_bounds(world: World) -> Bounds:
    """Extent of a map of the whole world: its streets and buildings and a margin, in metres."""
    items = [segment.polygon for segment in world.segments] + [building.polygon for building in world.buildings]
    west, south, east, north = (float(value) for value in shapely.total_bounds(items))
    return west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M


def credit(world: World) -> str | None:
    """The attribution required under a map of this world."""
    return attribution(load_record(world.folder).source) if world.folder is not None else None


def sidewalks(world: World) -> BaseGeometry:
    """Sidewalks and junctions, with the gaps of centimetres between them closed; carriageways are drawn over them."""
    lanes = world.lanes_of(LaneKind.SIDEWALK)
    strips = [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in lanes]
    ground = [*strips, *(junction.polygon for junction in world.junctions)]
    return shapely.union_all(shapely.buffer(np.array(ground, dtype=object), 0.05, join_style="mitre"))


def lane_lines(world: World) -> list[Float64Array]:
    """The lines between lanes: of every driving edge between its own lanes, and between the directions of a street."""
    lines: list[Geometry] = []
    for street in world.streets:
        for edge in street.edges:
            lanes = world.lanes_on(edge, LaneKind.DRIVING)
            divided = lanes if len(street.edges) > 1 and edge == street.edges[0] else lanes[:-1]
            lines += [world.beside(lane, lane.width_m / 2) for lane in divided]
    if not lines:
        return []
    inside = shapely.intersection(np.array(lines, dtype=object), shapely.buffer(world.carriageway, -_KERB_M))
    parts = shapely.get_parts(inside)
    return [shapely.get_coordinates(part) for part in parts if isinstance(part, LineString) and part.length > 2.0]
