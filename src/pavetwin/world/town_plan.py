"""The street plan of a generated small town: centre lines without lanes.

A bent main street and a through road cross obliquely at the town's centre. In each quarter between them an outer street
closes a first large block, which is subdivided by streets that meet their neighbours at right angles and curve between
them. Then some pieces are removed, so that blocks become irregular, and crescents and closes are added at the edge. The
same seed gives the same plan; a plan that breaks a rule of `faults` is discarded and the next one is tried.

Its last steps are a park, removed streets, crescents at the edge, and closes.
"""

import math
from dataclasses import dataclass

import numpy as np
from shapely import LineString, Point, Polygon, covers, linestrings, prepare, union_all

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.errors import PaveTwinError
from pavetwin.seeds import Stream, child
from pavetwin.world.street_graph import (
    CLEARANCE_M,
    MAIN,
    MAIN_SPACING_M,
    NODE_SPACING_M,
    THROUGH,
    Coordinate,
    Door,
    StreetGraph,
    add_street,
    fits,
    hermite,
    link,
    part_of,
    tangent,
    through,
    turned,
    unit,
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


LEAST_ANGLE_DEG = 40.0


@dataclass(frozen=True, slots=True)
class TownPlan:
    """Centre lines and what they enclose, in metres around the crossing of the main roads at (0, 0)."""

    graph: StreetGraph
    crossing: int
    """The node where the main street and the through road meet."""
    park: Polygon
    """A block, up to its streets' centre lines."""


def plan_town(seed: int) -> TownPlan:
    """The streets of the town of this seed.

    Raises:
        PaveTwinError: forty attempts all broke a rule (never seen).
    """
    for attempt in range(40):
        plan = _attempt(child(seed, Stream.WORLD, attempt))
        if plan is not None and not faults(plan):
            return plan
    raise PaveTwinError(f"No town could be drawn for the seed {seed}; choose another `seed`.")


def _attempt(rng: np.random.Generator) -> TownPlan | None:
    graph, arms = _main_roads(rng)
    crossing = 0
    outer = [_outer_street(graph, arms, quarter, rng) for quarter in range(4)]
    if not all(outer):
        return None
    _parcel(graph, rng)
    park = choose_park(graph, rng)
    remove_some(graph, park, rng)
    graph.join_bends(18.0)
    crescents(graph, rng, count=int(rng.integers(1, 3)))
    closes(graph, park, rng, count=int(rng.integers(2, 4)))
    return TownPlan(graph, crossing, park)


def faults(plan: TownPlan) -> list[str]:
    """Rules that a plan breaks: connected, no sharp corners, no junctions on top of each other, no stray crossing."""
    graph, found = plan.graph, []
    if not graph.connected_without():
        found.append("not connected")
    for node in range(len(graph.nodes)):
        if graph.degree(node) > 1 and graph.sharpest_angle_deg(node) < LEAST_ANGLE_DEG:
            found.append(f"sharp corner at {graph.nodes[node]}")
        if graph.degree(node) > 4:
            found.append(f"more than four arms at {graph.nodes[node]}")
    pieces = list(graph.pieces.values())
    for i, a in enumerate(pieces):
        if a.length_m < 30.0:
            found.append(f"short stretch of {a.length_m:.0f} m")
        if not a.line.is_simple:
            found.append("a street crosses itself")
        for b in pieces[i + 1 :]:
            shared = {a.start, a.end} & {b.start, b.end}
            inner = part_of(b.line, 16.0, b.length_m - 16.0) if shared else b.line
            if a.line.distance(inner) < (9.0 if shared else CLEARANCE_M * 0.8):
                found.append("two streets too close")
    length = sum(piece.length_m for piece in pieces)
    if not 3_400 <= length <= 4_800:
        found.append(f"{length:.0f} m of street")
    return found


# --- The two main roads ---------------------------------------------------------------------------------------------


def _main_roads(rng: np.random.Generator) -> tuple[StreetGraph, list[LineString]]:
    """The two roads and their four arms as seen from the crossing, counter-clockwise."""
    heading = float(rng.uniform(-28, 28))
    oblique = float(rng.uniform(64, 80)) * (1 if rng.random() < 0.5 else -1)
    oblique = oblique if oblique > 0 else 180 + oblique
    graph = StreetGraph()
    crossing = graph.add_node((0.0, 0.0))
    bend = float(rng.uniform(12, 24)) * (1 if rng.random() < 0.5 else -1)
    arms = []
    for k in range(4):
        base = heading + (k % 2) * oblique + (k // 2) * 180
        lean = bend if k % 2 == 0 else float(rng.uniform(-16, 16))
        leave = unit(turned(np.array([1.0, 0.0]), base))
        near = leave * RADIUS_M * 0.3
        middle = near + unit(turned(leave, lean * 0.7)) * RADIUS_M * 0.35
        far = middle + unit(turned(leave, lean * (1.2 if k % 2 == 0 else -0.6))) * RADIUS_M * 0.42
        arms.append(through(np.array([(0.0, 0.0), near, middle, far])))
        end = graph.add_node(arms[-1].coords[-1])
        graph.new_stroke() if k < 2 else None
        graph.add_piece(crossing, end, arms[-1], MAIN if k % 2 == 0 else THROUGH)
    return graph, arms


def _outer_street(graph: StreetGraph, arms: list[LineString], quarter: int, rng: np.random.Generator) -> bool:
    """The street that closes a quarter, from one arm round to the next; false when it would not fit."""
    a, b = arms[quarter], arms[(quarter + 1) % 4]
    for _ in range(30):
        at_a, at_b = (float(rng.uniform(140, min(265.0, arm.length - 70))) for arm in (a, b))
        places = (np.array(arm.interpolate(at).coords[0]) for arm, at in ((a, at_a), (b, at_b)))
        start, end = (_settle(graph, place, rng) for place in places)
        if start is None or end is None:
            continue
        reach = math.dist(start, end)
        leave = turned(tangent(a, at_a), 90 + float(rng.uniform(-12, 8))) * reach * float(rng.uniform(1.0, 2.3))
        arrive = turned(tangent(b, at_b), 90 + float(rng.uniform(-8, 12))) * reach * float(rng.uniform(1.0, 2.3))
        line = hermite(start, leave, end, arrive)
        if line.length < 480 and fits(graph, line):
            add_street(graph, line)
            return True
    return False


def _settle(graph: StreetGraph, point: Float64Array, rng: np.random.Generator) -> Float64Array | None:
    """A point on a street moved onto a junction that is near, or none when it is too near to one to stand alone."""
    nearest = min((n for n in range(len(graph.nodes))), key=lambda n: math.dist(graph.nodes[n], point))
    gap = math.dist(graph.nodes[nearest], point)
    if gap > MAIN_SPACING_M:
        return point
    if gap < 30 and graph.degree(nearest) == 3 and rng.random() < 0.4:
        return np.array(graph.nodes[nearest])
    return None


# --- Parcelling the quarters ----------------------------------------------------------------------------------------


def _parcel(graph: StreetGraph, rng: np.random.Generator) -> None:
    """Split blocks until none is larger than its location in the town allows."""
    settled: set[Coordinate] = set()
    while True:
        blocks = [face for face in graph.faces() if (face.centroid.x, face.centroid.y) not in settled]
        if not blocks:
            return
        block = max(blocks, key=lambda face: float(face.area))
        remoteness = min(1.0, block.centroid.distance(Point(0, 0)) / 200)
        allowed = (6_900 + 7_600 * remoteness) * float(rng.uniform(0.85, 1.35))
        middle = (block.centroid.x, block.centroid.y)
        street = _splitting_street(graph, block, rng) if block.area > allowed else None
        if street is None:
            settled.add(middle)
        else:
            add_street(graph, street)


def _doors(graph: StreetGraph, block: Polygon) -> list[Door]:
    """Places along a block's outline, looking into it, that keep their distance from its junctions."""
    ring = block.exterior
    corners = [
        n for n in range(len(graph.nodes)) if graph.degree(n) > 0 and ring.distance(Point(graph.nodes[n])) < 0.01
    ]
    main = [piece.line for piece in graph.pieces.values() if piece.stroke in (MAIN, THROUGH)]
    doors = []
    for along in np.arange(0, ring.length, 8.0):
        spot = ring.interpolate(along)
        before, after = ring.interpolate((along - 4) % ring.length), ring.interpolate((along + 4) % ring.length)
        inward = turned(unit(np.array([after.x - before.x, after.y - before.y])), 90)
        spacing = MAIN_SPACING_M if any(line.distance(spot) < 0.1 for line in main) else NODE_SPACING_M
        if all(spot.distance(Point(graph.nodes[n])) > spacing for n in corners):
            doors.append(Door(np.array([spot.x, spot.y]), inward, junction=False, along_m=float(along)))
    for n in corners:
        along = float(ring.project(Point(graph.nodes[n])))
        before, after = ring.interpolate((along - 8) % ring.length), ring.interpolate((along + 8) % ring.length)
        here = np.array(graph.nodes[n])
        one, two = unit(np.array(before.coords[0]) - here), unit(np.array(after.coords[0]) - here)
        if graph.degree(n) == 3 and float(one @ two) < -0.94:
            doors.append(Door(here, turned(unit(two - one), 90), junction=True, along_m=along))
    return doors


def _splitting_street(graph: StreetGraph, block: Polygon, rng: np.random.Generator) -> LineString | None:
    """The street that halves a block best: short, square to what it meets, the two parts alike."""
    doors = _doors(graph, block)
    roomy = block.buffer(0.5)  # so that a cut from rim to rim lies inside
    prepare(roomy)
    crossing_wanted = bool(rng.random() < 0.3)
    first, second = np.triu_indices(len(doors), 1)
    if len(first) == 0:
        return None
    position, outward = np.array([d.position for d in doors]), np.array([d.outward for d in doors])
    junction = np.array([d.junction for d in doors])
    chord = position[second] - position[first]
    length = np.hypot(*chord.T)
    squareness = np.minimum((outward[first] * chord).sum(axis=1), -(outward[second] * chord).sum(axis=1)) / length
    usable = (length > 55) & (squareness > 0.72) & ~(junction[first] & junction[second])
    usable[usable] &= covers(roomy, linestrings(np.stack([position[first], position[second]], axis=1)[usable]))
    snapped = (0.25 if crossing_wanted else -0.4) * (junction[first] | junction[second])
    score = (
        _inequality(block, np.array([d.along_m for d in doors]), first, second)
        + 0.0035 * length
        + 1.1 * (1 - squareness)
        - snapped
        + rng.uniform(0, 0.22, len(first))
    )
    score[~usable] = np.inf
    for best in np.argsort(score, kind="stable")[: min(30, int(usable.sum()))]:
        a, b = doors[int(first[best])], doors[int(second[best])]
        line = link(a, b, float(rng.uniform(0.75, 1.15)), float(rng.uniform(-9, 9)))
        if fits(graph, line) and roomy.covers(line):
            return line
    return None


def _inequality(block: Polygon, along: Float64Array, first: IndexArray, second: IndexArray) -> Float64Array:
    """Inequality of the parts of a block, cut between two places of its outline: 0 equal, 1 nothing on one side.

    By the shoelace formula: the area swept from the outline's start, at a place, is linear between vertices.
    """
    ring = np.array(block.exterior.coords)
    steps = np.hypot(*np.diff(ring, axis=0).T)
    cross = ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1]
    lengths, areas = (np.concatenate([[0.0], np.cumsum(part)]) for part in (steps, cross / 2))
    swept = np.interp(along, lengths, areas)
    x, y = (np.interp(along, lengths, ring[:, axis]) for axis in (0, 1))
    closing = (x[second] * y[first] - x[first] * y[second]) / 2
    part: Float64Array = np.abs(swept[second] - swept[first] + closing)
    unequal: Float64Array = np.abs(2 * part / float(block.area) - 1)
    return unequal
