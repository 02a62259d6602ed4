"""A planar street graph under construction: nodes, the curved pieces between them, and the blocks they enclose.

Used by the town's procedure. Coordinates are metres (east, north) around the main crossing; distances along a piece are
metres from its start.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from shapely import LineString, Point, Polygon, polygonize
from shapely.geometry.polygon import orient
from shapely.ops import substring

from pavetwin.arrays import Float64Array
from pavetwin.world.groups import groups

Coordinate = tuple[float, float]

CURVE_STEP_M = 7.0
"""Distance between the points of a drawn curve [m]."""
NODE_SPACING_M = 36.0
"""Least distance between two junctions on a side street [m]; room for queues and crossings."""
MAIN_SPACING_M = 52.0
"""Distance on the main street and the through road."""
CLEARANCE_M = 30.0
"""Least distance between streets that do not meet [m]: two rows of gardens, or one of houses."""
MAIN, THROUGH = 0, 1
"""Strokes of the two main roads."""


@dataclass(slots=True)
class Piece:
    """A stretch of street between two nodes. Pieces of one `stroke` are one street with one name."""

    start: int
    end: int
    line: LineString
    stroke: int

    @property
    def length_m(self) -> float:
        return float(self.line.length)

    def leaving(self, node: int) -> LineString:
        """The centre line, starting from one of its nodes."""
        return self.line if node == self.start else self.line.reverse()


class StreetGraph:
    """Nodes and pieces that meet only at nodes. `add_piece` splits no piece; `node_on` does."""

    def __init__(self) -> None:
        self.nodes: list[Coordinate] = []
        self.pieces: dict[int, Piece] = {}
        self._next_piece = 0
        self._next_stroke = 0

    def new_stroke(self) -> int:
        self._next_stroke += 1
        return self._next_stroke - 1

    def add_node(self, at: Iterable[float]) -> int:
        x, y = at
        self.nodes.append((float(x), float(y)))
        return len(self.nodes) - 1

    def add_piece(self, start: int, end: int, line: LineString, stroke: int) -> int:
        """A piece whose line is made to begin and end exactly at its nodes."""
        coordinates = list(line.coords)
        coordinates[0], coordinates[-1] = self.nodes[start], self.nodes[end]
        key = self._next_piece
        self.pieces[key] = Piece(start, end, LineString(coordinates), stroke)
        self._next_piece += 1
        return key

    def node_on(self, at: Iterable[float], *, snap_m: float = 1.0) -> int:
        """The node at a point of the graph: an existing one within `snap_m`, else the piece there is split.

        Raises:
            ValueError: no piece passes within a metre of the point.
        """
        point = Point(*at)
        for known, place in enumerate(self.nodes):
            if math.dist(place, (point.x, point.y)) < snap_m and self.degree(known) > 0:
                return known
        key = min(self.pieces, key=lambda k: self.pieces[k].line.distance(point))
        if self.pieces[key].line.distance(point) > 1.0:
            raise ValueError(f"no street passes at {point.x:.1f}, {point.y:.1f}")
        piece = self.pieces.pop(key)
        along = float(piece.line.project(point))
        node = self.add_node(piece.line.interpolate(along).coords[0])
        self.add_piece(piece.start, node, part_of(piece.line, 0, along), piece.stroke)
        self.add_piece(node, piece.end, part_of(piece.line, along, piece.length_m), piece.stroke)
        return node

    def at(self, node: int) -> list[int]:
        """The pieces that end at a node."""
        return [key for key, piece in self.pieces.items() if node in (piece.start, piece.end)]

    def degree(self, node: int) -> int:
        return sum((piece.start == node) + (piece.end == node) for piece in self.pieces.values())

    def faces(self) -> list[Polygon]:
        """The blocks, counter-clockwise, bounded by centre lines."""
        parts = polygonize([piece.line for piece in self.pieces.values()]).geoms
        return [orient(Polygon(face.exterior), 1.0) for face in parts if isinstance(face, Polygon)]

    def pieces_around(self, face: Polygon) -> list[int]:
        """The pieces on a block's outline."""
        ring = face.exterior
        return [
            key
            for key, piece in self.pieces.items()
            if ring.distance(piece.line.interpolate(0.5, normalized=True)) < 0.01
        ]

    def connected_without(self, dropped: int | None = None) -> bool:
        """Whether every node that has a street can be reached from every other, with one piece left out."""
        used = {node for piece in self.pieces.values() for node in (piece.start, piece.end)}
        group = groups((piece.start, piece.end) for key, piece in self.pieces.items() if key != dropped)
        return group.keys() == used and len(set(group.values())) == 1

    def join_bends(self, radius_m: float) -> None:
        """Make one piece of any two that meet at a node with no third, rounding the corner between them."""
        for node in range(len(self.nodes)):
            keys = self.at(node)
            if self.degree(node) != 2 or len(keys) != 2:
                continue
            first, second = self.pieces[keys[0]], self.pieces[keys[1]]
            line = rounded(first.leaving(node).reverse(), second.leaving(node), radius_m)
            start = first.start if first.end == node else first.end
            end = second.end if second.start == node else second.start
            if start == end:
                continue
            stroke = (first if first.length_m >= second.length_m else second).stroke
            del self.pieces[keys[0]], self.pieces[keys[1]]
            self.add_piece(start, end, line, stroke)

    def sharpest_angle_deg(self, node: int, reach_m: float = 14.0) -> float:
        """Smallest angle between two neighbouring arms of a node, each taken over its first metres; 360 for one arm."""
        bearings = []
        for key in self.at(node):
            far = self.pieces[key].leaving(node).interpolate(reach_m)
            bearings.append(math.degrees(math.atan2(far.y - self.nodes[node][1], far.x - self.nodes[node][0])) % 360)
        bearings.sort()
        turned = [*bearings[1:], bearings[0] + 360] if bearings else []
        return min((b - a for a, b in zip(bearings, turned, strict=True)), default=360.0)


def part_of(line: LineString, start_m: float, end_m: float) -> LineString:
    """The stretch of a line between two distances along it, at least a centimetre long."""
    end_m = max(end_m, start_m + 0.01)
    return LineString(substring(line, start_m, end_m).coords)


def unit(vector: Float64Array) -> Float64Array:
    return vector / float(np.hypot(*vector))


def turned(vector: Float64Array, angle_deg: float) -> Float64Array:
    """The vector turned counter-clockwise."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def hermite(start: Float64Array, leave: Float64Array, end: Float64Array, arrive: Float64Array) -> LineString:
    """The cubic from `start` with velocity `leave` to `end` with velocity `arrive`, as a polyline."""
    count = max(3, round(float(np.hypot(*(end - start))) * 1.15 / CURVE_STEP_M) + 1)
    t = np.linspace(0, 1, count)[:, None]
    # Products, which are the same on every processor: powers are not, to the last digit.
    square = t * t
    cube = square * t
    points = (
        (2 * cube - 3 * square + 1) * start
        + (cube - 2 * square + t) * leave
        + (3 * square - 2 * cube) * end
        + (cube - square) * arrive
    )
    return LineString(points)


def through(points: Float64Array) -> LineString:
    """A smooth curve through points of shape (n, 2): Catmull-Rom, the ends reflected."""
    padded = np.vstack([2 * points[0] - points[1], points, 2 * points[-1] - points[-2]])
    parts: list[Coordinate] = []
    for i in range(1, len(padded) - 2):
        leave, arrive = (padded[i + 1] - padded[i - 1]) / 2, (padded[i + 2] - padded[i]) / 2
        parts += [(x, y) for x, y in hermite(padded[i], leave, padded[i + 1], arrive).coords][:-1]
    return LineString([*parts, (float(points[-1][0]), float(points[-1][1]))])


def rounded(arriving: LineString, leaving: LineString, radius_m: float) -> LineString:
    """Two lines that meet end to start, joined by a quadratic curve where they bend."""
    cut = min(radius_m, arriving.length * 0.4, leaving.length * 0.4)
    head = part_of(arriving, 0, arriving.length - cut)
    tail = part_of(leaving, cut, leaving.length)
    a, corner, b = (np.array(p) for p in (head.coords[-1], leaving.coords[0], tail.coords[0]))
    t = np.linspace(0, 1, 7)[1:-1, None]
    curve = (1 - t) ** 2 * a + 2 * t * (1 - t) * corner + t**2 * b
    return LineString([*head.coords, *map(tuple, curve), *tail.coords])


# --- Where a new street may run --------------------------------------------------------------------------------------


def tangent(line: LineString, along_m: float) -> Float64Array:
    a, b = line.interpolate(max(along_m - 4, 0)), line.interpolate(min(along_m + 4, line.length))
    return unit(np.array([b.x - a.x, b.y - a.y]))


@dataclass(frozen=True, slots=True)
class Door:
    """A place on a street where another may begin: its position and the direction away from the street."""

    position: Float64Array
    outward: Float64Array
    junction: bool
    along_m: float = 0.0
    """Its place on the outline of the block that it opens into."""


def link(a: Door, b: Door, slack: float, twist_deg: float) -> LineString:
    reach = slack * math.dist(a.position, b.position)
    return hermite(a.position, turned(a.outward, twist_deg) * reach, b.position, -turned(b.outward, twist_deg) * reach)


def add_street(graph: StreetGraph, line: LineString) -> None:
    start, end = graph.node_on(line.coords[0]), graph.node_on(line.coords[-1])
    graph.add_piece(start, end, line, graph.new_stroke())


def fits(graph: StreetGraph, line: LineString, *, ends: int = 2) -> bool:
    """Whether a new street keeps its distance from all others, except at its first end or both `ends`."""
    if line.length < 50 or not line.is_simple:
        return False
    free = part_of(line, CLEARANCE_M + 8, line.length - (CLEARANCE_M + 8) * (ends - 1))
    near_ends = part_of(line, 12, line.length - 12 * (ends - 1))
    return all(
        piece.line.distance(free) > CLEARANCE_M and piece.line.distance(near_ends) > 9.5
        for piece in graph.pieces.values()
    )
