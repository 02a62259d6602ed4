"""The last steps of a town plan: a park, removed streets, crescents at the edge, and closes.

Coordinates are metres around the main crossing.
"""

import math

import numpy as np
from shapely import LineString, Point, Polygon, union_all

from pavetwin.world.street_graph import (
    MAIN,
    MAIN_SPACING_M,
    NODE_SPACING_M,
    THROUGH,
    Door,
    StreetGraph,
    add_street,
    fits,
    hermite,
    link,
    tangent,
    turned,
)

RADIUS_M = 340.0
"""From the centre to where the two main roads leave the map [m]."""


def choose_park(graph: StreetGraph, rng: np.random.Generator) -> Polygon:
    """The block that becomes the park: of fair size, near the centre but not at the main crossing."""

    def unfit(face: Polygon) -> float:
        return (
            abs(float(face.area) - 13_000) / 13_000
            + face.centroid.distance(Point(0, 0)) / 350
            + 0.6 * (face.distance(Point(0, 0)) < 1)
            + float(rng.uniform(0, 0.5))
        )

    return min(graph.faces(), key=unfit)


def remove_some(graph: StreetGraph, park: Polygon, rng: np.random.Generator) -> None:
    """Remove a few pieces of side street where the network stays connected and no block becomes too large."""
    kept = set(graph.pieces_around(park))
    keys = [key for key, piece in graph.pieces.items() if piece.stroke > THROUGH and key not in kept]
    rng.shuffle(keys)
    remaining, stubs = int(rng.integers(3, 6)), 0
    for key in keys:
        piece = graph.pieces[key]
        degrees = [graph.degree(piece.start), graph.degree(piece.end)]
        stub = min(degrees) == 2
        if remaining == 0 or min(degrees) < 2 or (stub and stubs > 0) or not graph.connected_without(key):
            continue
        beside = [face for face in graph.faces() if face.exterior.distance(piece.line.centroid) < 25]
        if sum(float(face.area) for face in beside if face.covers(piece.line)) > 30_000:
            continue
        if sum(_bends_without(graph, n, key) for n in (piece.start, piece.end)) > 1:
            continue
        del graph.pieces[key]
        remaining, stubs = remaining - 1, stubs + stub


def _bends_without(graph: StreetGraph, node: int, dropped: int) -> bool:
    """Whether a node becomes a mere bend in one street when a stretch is dropped."""
    if graph.degree(node) != 3:
        return False
    one, two = (graph.pieces[key].leaving(node) for key in graph.at(node) if key != dropped)
    return float(tangent(one, 6) @ tangent(two, 6)) > -0.8


def _outer_doors(graph: StreetGraph, *, inside: bool) -> list[Door]:
    """Places along all streets, looking to either side; only those that look out of town unless `inside`."""
    town = union_all(graph.faces())
    doors = []
    for piece in graph.pieces.values():
        spacing = MAIN_SPACING_M if piece.stroke in (MAIN, THROUGH) else NODE_SPACING_M
        for along in np.arange(spacing, piece.length_m - spacing, 8.0):
            spot = np.array(piece.line.interpolate(along).coords[0])
            for side in (90, -90):
                outward = turned(tangent(piece.line, along), side)
                if np.hypot(*spot) < RADIUS_M - 45 and (inside or not town.covers(Point(*(spot + 12 * outward)))):
                    doors.append(Door(spot, outward, junction=False))
    return doors


def crescents(graph: StreetGraph, rng: np.random.Generator, count: int) -> None:
    """Loops at the edge of town: from one street back to it, or to its neighbour."""
    for _ in range(count):
        doors = _outer_doors(graph, inside=False)
        for _ in range(400 if doors else 0):
            a, b = (doors[int(i)] for i in rng.integers(0, len(doors), 2))
            chord = b.position - a.position
            length = float(np.hypot(*chord))
            if (
                not 75 < length < 170
                or float(a.outward @ chord) < -0.25 * length
                or float(-b.outward @ chord) < -0.25 * length
            ):
                continue
            line = link(a, b, float(rng.uniform(1.0, 1.8)), 0.0)
            if line.length < 330 and _inside_map(line) and fits(graph, line):
                add_street(graph, line)
                break


def closes(graph: StreetGraph, park: Polygon, rng: np.random.Generator, count: int) -> None:
    """Dead ends: short streets into a large block or out of town."""
    for _ in range(count):
        doors = [door for door in _outer_doors(graph, inside=True) if np.hypot(*door.position) > 110]
        for _ in range(300 if doors else 0):
            door = doors[int(rng.integers(0, len(doors)))]
            length, bend = float(rng.uniform(55, 85)), float(rng.uniform(-50, 50))
            end = door.position + turned(door.outward, bend * 0.45) * length
            line = hermite(door.position, door.outward * length, end, turned(door.outward, bend) * length)
            if _inside_map(line) and not park.intersects(line) and fits(graph, line, ends=1):
                start = graph.node_on(line.coords[0])
                graph.add_piece(start, graph.add_node(line.coords[-1]), line, graph.new_stroke())
                break


def _inside_map(line: LineString) -> bool:
    return max(math.hypot(x, y) for x, y in line.coords) < RADIUS_M - 12
