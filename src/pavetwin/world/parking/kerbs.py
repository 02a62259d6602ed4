"""Kerbs of a world's streets, and the parking places along them.

A street has a kerb on each side. Its line is the outer border of the carriageway, in the direction of the adjacent
traffic: along a two-way street each kerb belongs to one directed edge, along a one-way street both to the same.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, Point, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import GeometryArray
from pavetwin.world.model import Lane, LaneKind
from pavetwin.world.parking.mapped import MappedWay
from pavetwin.world.parking.place import ParkingOrientation, ParkingPosition, StreetSide
from pavetwin.world.parking.rule import ParkingRule, PlaceSize
from pavetwin.world.segments import StreetSurface

STEP_M = 1.0
"""Distance at which a kerb is compared with the map [m]."""

MAX_ANGLE_RAD = math.radians(30.0)
"""A way of the map that runs at a larger angle to a kerb is another street."""

REACH_BESIDE_M = 6.0
"""Largest distance of the line of a mapped way from a street's carriageway [m]."""

SHORTEST_M = 2.0
"""Shorter pieces have no room for a vehicle [m]."""

KerbInterval = tuple[float, float]
"""Interval of stations along a kerb [m]."""


@dataclass(frozen=True)
class Kerb:
    """Side of a street."""

    street: StreetSurface
    edge: str
    """Directed edge next to it."""
    side: StreetSide
    """Side of the street, along its centre line."""
    line: LineString
    """Kerb line in the direction of traffic."""
    outward: int
    """Side of `line` away from the carriageway: 1 left, −1 right."""
    parking_m: float
    """Width of the parking lane along it; 0 without one."""

    @property
    def length_m(self) -> float:
        return float(self.line.length)

    @cached_property
    def width_m(self) -> float:
        """Mean width of the street's carriageway."""
        return float(self.street.polygon.area) / self.street.length_m

    @cached_property
    def driven_m(self) -> float:
        """Mean width of the carriageway without its parking lanes."""
        lanes = (lane for edge in self.street.edges for lane in edge.lanes if lane.kind is LaneKind.PARKING)
        return self.width_m - sum(lane.width_m for lane in lanes)

    def at(self, station_m: float) -> tuple[Point, tuple[float, float]]:
        """The point at a station and the unit vector (dx, dy) along the kerb there, over 4 m."""
        before, after = (
            self.line.interpolate(min(max(station_m + shift, 0.0), self.length_m)) for shift in (-2.0, 2.0)
        )
        length = math.hypot(after.x - before.x, after.y - before.y) or 1.0
        return self.line.interpolate(station_m), ((after.x - before.x) / length, (after.y - before.y) / length)

    def stations_within(self, shape: BaseGeometry) -> Iterator[KerbInterval]:
        """The parts of the kerb that lie within a shape."""
        for part in shapely.get_parts(self.line.intersection(shape)):
            if isinstance(part, Point | LineString) and not part.is_empty:
                stations = shapely.line_locate_point(self.line, shapely.points(part.coords))
                yield float(stations.min()), float(stations.max())


def kerbs_of(streets: Sequence[StreetSurface], left_hand: bool) -> Iterator[Kerb]:
    """The kerbs of all streets, the right one of each street first."""
    outer = 1 if left_hand else -1  # of the lane at the kerb
    for street in streets:
        first = street.edges[0]
        two_way = len(street.edges) == 2
        other = street.edges[1] if two_way else first
        near = _kerb(street, first.id, first.carriageway[0], outer, _side(outer))
        far = (
            _kerb(street, other.id, other.carriageway[0], outer, _side(-outer))
            if two_way
            else _kerb(street, first.id, first.carriageway[-1], -outer, _side(-outer))
        )
        yield from (kerb for kerb in (near, far) if kerb is not None)


def _side(left: int) -> StreetSide:
    return StreetSide.LEFT if left > 0 else StreetSide.RIGHT


def _kerb(street: StreetSurface, edge: str, lane: Lane, outward: int, side: StreetSide) -> Kerb | None:
    moved = shapely.offset_curve(lane.centre_line, outward * lane.width_m / 2, join_style="mitre", mitre_limit=2.0)
    parts = [part for part in shapely.get_parts(moved) if isinstance(part, LineString)]
    line = max(parts, key=lambda part: part.length, default=None)
    if line is None or line.length < SHORTEST_M:
        return None
    return Kerb(street, edge, side, line, outward, lane.width_m if lane.kind is LaneKind.PARKING else 0.0)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a kerb along one way of the map, or along none."""

    start_m: float
    end_m: float
    way: MappedWay | None
    side: StreetSide
    """Line of the way, in its own direction."""


class WayIndex:
    """Finds the way of the map that a kerb belongs to."""

    def __init__(self, ways: Sequence[MappedWay]) -> None:
        self._ways = ways
        pieces = [(index, start, end) for index, way in enumerate(ways) for start, end in pairwise(way.line.coords)]
        self._owner = np.array([index for index, *_ in pieces], dtype=np.intp)
        self._yaw = np.array([math.atan2(end[1] - start[1], end[0] - start[0]) for _, start, end in pieces])
        self._pieces: GeometryArray = np.array([LineString(ends) for _, *ends in pieces], dtype=object)
        self._tree = STRtree(self._pieces)

    def stretches(self, kerb: Kerb) -> list[Stretch]:
        """The kerb cut where the way along it changes."""
        if not self._ways:
            return [Stretch(0.0, kerb.length_m, None, StreetSide.RIGHT)]
        count = max(1, math.ceil(kerb.length_m / STEP_M))
        borders = np.linspace(0.0, kerb.length_m, count + 1)
        found: list[Stretch] = []
        for start, end in pairwise(borders):
            way, side = self._way_along(kerb, float(start + end) / 2)
            if found and found[-1].way is way and found[-1].side is side:
                found[-1] = Stretch(found[-1].start_m, float(end), way, side)
            else:
                found.append(Stretch(float(start), float(end), way, side))
        return found

    def _way_along(self, kerb: Kerb, station_m: float) -> tuple[MappedWay | None, StreetSide]:
        point, (dx, dy) = kerb.at(station_m)
        near = self._tree.query(point, predicate="dwithin", distance=kerb.width_m + REACH_BESIDE_M)
        turn = self._yaw[near] - math.atan2(dy, dx)
        along = np.cos(turn)
        near, along = near[np.abs(along) >= math.cos(MAX_ANGLE_RAD)], along[np.abs(along) >= math.cos(MAX_ANGLE_RAD)]
        if not len(near):
            return None, StreetSide.RIGHT
        apart = shapely.distance(self._pieces[near], point)
        named = np.array([self._ways[owner].name == kerb.street.street.name for owner in self._owner[near]])
        best = int(np.lexsort((apart, ~named))[0])
        return self._ways[self._owner[near[best]]], _side(kerb.outward if along[best] > 0 else -kerb.outward)


CAPACITY_SPACING = (0.8, 1.5)
"""Spacings of places, as shares of the rule's, at which a capacity on the map is taken as it is."""


@dataclass(frozen=True, slots=True)
class Slot:
    """Place along a kerb, regardless of its surroundings."""

    station_m: float
    """Station of its centre."""
    centre: Point
    yaw_rad: float
    length_m: float
    width_m: float


def depth_m(size: PlaceSize) -> float:
    """Extent of a place across the street."""
    angle = math.radians(size.angle_deg)
    return size.length_m * math.sin(angle) + size.width_m * math.cos(angle)


def lane_depth_m(position: ParkingPosition, depth: float) -> float:
    """Part of a place's depth that lies on the carriageway and takes a parking lane; 0 off the carriageway."""
    match position:
        case ParkingPosition.LANE:
            return depth
        case ParkingPosition.HALF_ON_KERB:
            return depth / 2
        case _:
            return 0.0


def slots_in(
    kerb: Kerb,
    interval: KerbInterval,
    orientation: ParkingOrientation,
    inner_m: float,
    rule: ParkingRule,
    spacing_m: float | None = None,
) -> Iterator[Slot]:
    """The places that fit into an interval, centred in it.

    Args:
        inner_m: where the places begin, outwards from the kerb; below 0 on the carriageway.
        spacing_m: along the kerb, where it is not the rule's.
    """
    size = rule.places[orientation]
    spacing = spacing_m or size.spacing_m
    angle = math.radians(size.angle_deg)
    extent = max(spacing, size.length_m * math.cos(angle) + size.width_m * math.sin(angle))
    room = interval[1] - interval[0]
    count = math.floor((room - extent) / spacing + 1 + 1e-9) if room >= extent else 0
    first = interval[0] + (room - (count - 1) * spacing) / 2
    middle = inner_m + depth_m(size) / 2
    for index in range(count):
        station = first + index * spacing
        foot, (dx, dy) = kerb.at(station)
        out = -dy * kerb.outward, dx * kerb.outward
        yield Slot(
            station,
            Point(foot.x + middle * out[0], foot.y + middle * out[1]),
            math.remainder(math.atan2(dy, dx) + kerb.outward * angle, math.tau),
            min(size.length_m, spacing) if orientation is ParkingOrientation.PARALLEL else size.length_m,
            size.width_m,
        )


def spacing_for(capacity: int | None, free_m: float, size: PlaceSize) -> float | None:
    """The spacing that gives the mapped capacity in what is free; None where it would be unlikely."""
    if not capacity:
        return None
    spacing = free_m / capacity
    low, high = CAPACITY_SPACING
    return spacing if low * size.spacing_m <= spacing <= high * size.spacing_m else None
