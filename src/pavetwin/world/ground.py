"""The ground for placing buildings and furniture: roads, kerbs, and what is placed already."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Generic, TypeVar

import shapely
from shapely import LineString, Point, Polygon, STRtree

from pavetwin.world.model import LaneKind, Segment
from pavetwin.world.roadnet import RoadNet
from pavetwin.world.segments import direction_at, lanes_polygon, point_at, polygons_of, union_of

Bounds = tuple[float, float, float, float]
"""West, south, east, north in metres of the world frame."""

Item = TypeVar("Item")


class Nearby(Generic[Item]):
    """Things by where they are, in a grid of square cells; more can be added at any time."""

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._cells: dict[tuple[int, int], list[tuple[Bounds, Item]]] = {}

    def add(self, bounds: Bounds, item: Item) -> None:
        for cell in self._covered(bounds):
            self._cells.setdefault(cell, []).append((bounds, item))

    def query(self, bounds: Bounds) -> Iterator[Item]:
        """Items whose bounds meet these; one may come more than once."""
        for cell in self._covered(bounds):
            for other, item in self._cells.get(cell, ()):
                if bounds[0] <= other[2] and other[0] <= bounds[2] and bounds[1] <= other[3] and other[1] <= bounds[3]:
                    yield item

    def _covered(self, bounds: Bounds) -> Iterator[tuple[int, int]]:
        low_x, low_y, high_x, high_y = (math.floor(value / self._cell_m) for value in bounds)
        return ((x, y) for x in range(low_x, high_x + 1) for y in range(low_y, high_y + 1))


def around(x: float, y: float, reach_m: float) -> Bounds:
    """The square of half-width `reach_m` around a point."""
    return x - reach_m, y - reach_m, x + reach_m, y + reach_m


class PlacementGround:
    """Roads (carriageways of every edge for cars, and junctions) on which nothing is placed."""

    def __init__(self, net: RoadNet) -> None:
        surfaces: list[Polygon] = []
        for edge in net.edges.values():
            if edge.carriageway:
                surfaces += polygons_of(lanes_polygon(edge.carriageway))
        surfaces += [part for junction in net.junctions for part in polygons_of(junction.polygon)]
        self.roads = surfaces
        self._roads = STRtree(surfaces)
        self.sidewalk_m = {
            edge.id: edge.sidewalk_width_m
            for edge in net.edges.values()
            if any(lane.kind is LaneKind.SIDEWALK for lane in edge.lanes)
        }

    def road_distance_m(self, thing: Point | Polygon) -> float:
        """Distance to the nearest road, 0 on it; infinite when there is none."""
        nearest = self._roads.nearest(thing)
        return math.inf if nearest is None else float(self.roads[int(nearest)].distance(thing))

    def roads_near(self, thing: Point | Polygon, within_m: float) -> list[Polygon]:
        return [self.roads[int(index)] for index in sorted(self._roads.query(thing, "dwithin", distance=within_m))]

    def beside_road(self, point: Point, clearance_m: float, furthest_m: float) -> Point | None:
        """The point, moved off the road to `clearance_m` behind the nearest kerb if it is nearer than that.

        None when it would have to move further than `furthest_m`.
        """
        if self.road_distance_m(point) >= clearance_m:
            return point
        near = union_of(self.roads_near(point, furthest_m + clearance_m), clearance_m + 0.01)
        borders = shapely.get_parts(near.boundary)
        moved = min((border.interpolate(border.project(point)) for border in borders), key=point.distance)
        if moved.distance(point) > furthest_m or self.road_distance_m(moved) < clearance_m - 0.01:
            return None
        return Point(moved.x, moved.y)

    def sidewalk_width_m(self, edges: Sequence[str]) -> float:
        """The widest sidewalk of a street's edges, 0 when it has none."""
        return max((self.sidewalk_m.get(edge, 0.0) for edge in edges), default=0.0)


def kerb(segment: Segment, station_m: float, side: int) -> tuple[Point, tuple[float, float]]:
    """The kerb at a station, on the left (side 1) or right (−1), and the unit vector (dx, dy) outwards."""
    x, y = point_at(segment.centre_line, station_m)
    dx, dy = direction_at(segment.centre_line, station_m, over_m=4.0)
    out = (-dy * side, dx * side)
    reach = 2.0 * segment.width_m + 5.0
    ray = LineString([(x, y), (x + out[0] * reach, y + out[1] * reach)])
    inside = shapely.get_parts(segment.polygon.intersection(ray))
    ends = [
        _furthest(part, x, y) for part in inside if isinstance(part, LineString) and part.distance(Point(x, y)) < 0.2
    ]
    half = max(ends, default=segment.width_m / 2)
    return Point(x + out[0] * half, y + out[1] * half), out


def _furthest(part: LineString, x: float, y: float) -> float:
    return max(math.hypot(px - x, py - y) for px, py in part.coords)


def evenly(length_m: float, spacing_m: float) -> Iterable[float]:
    """Stations about `spacing_m` apart, half of that from both ends; at least one."""
    count = max(1, round(length_m / spacing_m))
    return ((index + 0.5) * length_m / count for index in range(count))
