"""A town's plan made into roads: lanes, widths, speed limits, names, signals; written as SUMO's plain XML.

Lane widths follow common practice for built-up areas (Germany's RASt 06: 3.25 m on main streets, 2.75 m on residential
ones; sidewalks 2.5 m, in lanes 1.5 m).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from shapely import LineString, Point

from pavetwin.arrays import Float64Array
from pavetwin.seeds import Stream, child
from pavetwin.world.groups import groups
from pavetwin.world.street_graph import MAIN, THROUGH, Coordinate, Piece, StreetGraph
from pavetwin.world.town_plan import TownPlan

KMH = 1 / 3.6
CENTRE_REACH_M = 190.0
"""Distance from the crossing within which the main street keeps two lanes each way [m]."""

_MAIN_NAMES = ("Main Street", "High Street", "Market Street")
_THROUGH_NAMES = ("Mill Road", "Station Road", "Bridge Road", "Harbour Road", "Abbey Road")
_NAMES = (
    "Linden", "Church", "Orchard", "Meadow", "Chapel", "School", "Tanner", "Weaver", "Granary", "Poplar", "Chestnut",
    "Bell", "Fountain", "Garden", "Cooper", "Vineyard", "Well", "Rose", "Smith", "Brook", "Hazel", "Baker", "Quarry",
    "Swan", "Lark", "Walnut", "Priory", "Ropewalk", "Juniper", "Saddler", "Miller", "Heron", "Elder", "Castle",
)  # fmt: skip


_NO_RAILS = 'disallow="tram rail_urban rail rail_electric rail_fast subway cable_car ship container"'


class Rank(Enum):
    MAIN = 12
    THROUGH = 10
    SIDE = 5
    ONE_WAY = 3
    CLOSE = 2
    """A dead end. The values are SUMO's priorities."""


@dataclass(frozen=True, slots=True)
class Road:
    """One stretch of street between two junctions, with its cross-section."""

    id: str
    name: str
    start: int
    end: int
    centre_line: LineString
    rank: Rank
    lanes: int
    """In each direction; of a one-way street, in its only one."""
    lane_width_m: float
    sidewalk_m: float
    speed_limit_mps: float
    parking_m: float = 0.0
    """Width of the wider of its parking lanes, which are not part of the plain XML."""

    @property
    def one_way(self) -> bool:
        return self.rank is Rank.ONE_WAY

    @property
    def carriageway_m(self) -> float:
        return self.lane_width_m * self.lanes * (1 if self.one_way else 2)

    @property
    def half_width_m(self) -> float:
        """Distance from the centre line to the back of the wider sidewalk."""
        return self.carriageway_m / 2 + self.parking_m + self.sidewalk_m


@dataclass(frozen=True, slots=True)
class RoadPlan:
    nodes: dict[int, Coordinate]
    roads: tuple[Road, ...]
    signals: frozenset[int]


def plan_roads(plan: TownPlan, seed: int) -> RoadPlan:
    """Lanes, names and signals of a town, in the order of the plan's pieces."""
    rng = child(seed, Stream.WORLD, 1_000)
    graph = plan.graph
    one_way = _one_way_lanes(plan, rng)
    names = _street_names(graph, one_way, rng)
    taste = {stroke: rng.uniform(0, 1, 2) for stroke in sorted(set(names))}
    counts: dict[str, int] = {}
    roads = []
    for key in sorted(graph.pieces):
        piece = graph.pieces[key]
        name = names[key]
        counts[name] = counts.get(name, 0) + 1
        slug = f"{name.lower().replace(' ', '_')}_{counts[name]}"
        roads.append(_road(plan, piece, slug, name, key in one_way, taste[key]))
    used = {node: graph.nodes[node] for piece in graph.pieces.values() for node in (piece.start, piece.end)}
    return RoadPlan(dict(sorted(used.items())), tuple(roads), _signals(plan))


def _road(plan: TownPlan, piece: Piece, slug: str, name: str, one_way: bool, taste: Float64Array) -> Road:
    graph = plan.graph
    dead_end = min(graph.degree(piece.start), graph.degree(piece.end)) == 1
    width, walk = (float(x) for x in taste)
    if piece.stroke == MAIN:
        central = max(math.hypot(*graph.nodes[n]) for n in (piece.start, piece.end)) < CENTRE_REACH_M
        shape = (Rank.MAIN, 2, 3.25, 3.0, 50) if central else (Rank.MAIN, 1, 3.75, 2.5, 50)
    elif piece.stroke == THROUGH:
        shape = (Rank.THROUGH, 1, 3.5, 2.5, 50)
    elif one_way:
        shape = (Rank.ONE_WAY, 1, 3.5 + 0.5 * round(width), 1.5, 20)
    elif dead_end:
        shape = (Rank.CLOSE, 1, 2.75, 1.5, 30)
    else:
        shape = (Rank.SIDE, 1, (2.75, 3.0, 3.25)[int(width * 3)], (1.5, 2.0, 2.5)[int(walk * 3)], 30)
    rank, lanes, lane_width, sidewalk, kmh = shape
    return Road(slug, name, piece.start, piece.end, piece.line, rank, lanes, lane_width, sidewalk, round(kmh * KMH, 2))


def _one_way_lanes(plan: TownPlan, rng: np.random.Generator) -> set[int]:
    """Up to three short side streets near the centre that may be one-way while the network stays strongly connected."""
    graph = plan.graph
    near = [
        key
        for key, piece in sorted(graph.pieces.items())
        if piece.stroke > THROUGH
        and 45 < piece.length_m < 150
        and min(graph.degree(piece.start), graph.degree(piece.end)) > 2
        and piece.line.centroid.distance(Point(0, 0)) < 210
    ]
    rng.shuffle(near)
    chosen: set[int] = set()
    for key in near:
        touched = {n for k in chosen for n in (graph.pieces[k].start, graph.pieces[k].end)}
        alone = not touched & {graph.pieces[key].start, graph.pieces[key].end}
        if len(chosen) < 3 and alone and strongly_connected(graph, chosen | {key}):
            chosen.add(key)
    return chosen


def strongly_connected(graph: StreetGraph, one_way: set[int]) -> bool:
    """Whether a car can get from every junction to every other, driving one-way pieces from start to end only."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ways = [(piece.start, piece.end) for piece in graph.pieces.values()]
    ways += [(piece.end, piece.start) for key, piece in graph.pieces.items() if key not in one_way]
    nodes, ends = np.unique(np.array(ways).T, return_inverse=True)
    matrix = coo_array((np.ones(len(ways)), ends.reshape(2, -1)), shape=(len(nodes), len(nodes)))
    return bool(connected_components(matrix, connection="strong", return_labels=False) == 1)


def _street_names(graph: StreetGraph, one_way: set[int], rng: np.random.Generator) -> dict[int, str]:
    """A name for every piece: one for each connected part of a stroke."""
    stock = [_NAMES[int(i)] for i in rng.permutation(len(_NAMES))]
    main, cross = (str(rng.choice(names)) for names in (_MAIN_NAMES, _THROUGH_NAMES))
    names: dict[int, str] = {}
    for key in sorted(graph.pieces):
        if key in names:
            continue
        piece = graph.pieces[key]
        together = _connected_part(graph, key, one_way)
        if piece.stroke in (MAIN, THROUGH):
            name = main if piece.stroke == MAIN else cross
        else:
            dead_end = any(graph.degree(n) == 1 for k in together for n in (graph.pieces[k].start, graph.pieces[k].end))
            length = sum(graph.pieces[k].length_m for k in together)
            crooked = length > 1.5 * math.dist(graph.nodes[piece.start], graph.nodes[piece.end]) and len(together) == 1
            kind = (
                "Close"
                if dead_end and length < 110
                else "Lane"
                if key in one_way
                else "Crescent"
                if crooked
                else "Street"
            )
            name = f"{stock.pop() if stock else 'New'} {kind}"
        names |= dict.fromkeys(together, name)
    return names


def _connected_part(graph: StreetGraph, key: int, one_way: set[int]) -> list[int]:
    """The pieces of the same stroke connected with this one; a one-way lane is a separate street."""
    if key in one_way:
        return [key]
    stroke, start = graph.pieces[key].stroke, graph.pieces[key].start
    pieces = {k: piece for k, piece in graph.pieces.items() if piece.stroke == stroke and k not in one_way}
    group = groups((piece.start, piece.end) for piece in pieces.values())
    return sorted(k for k, piece in pieces.items() if group[piece.start] == group[start])


def _signals(plan: TownPlan) -> frozenset[int]:
    """Signals where the main roads cross and at the two busiest other junctions of the main street, well apart."""
    graph = plan.graph
    chosen = [plan.crossing]
    candidates = [
        node
        for node in range(len(graph.nodes))
        if graph.degree(node) > 2 and any(graph.pieces[key].stroke == MAIN for key in graph.at(node))
    ]
    for node in sorted(candidates, key=lambda n: (-graph.degree(n), math.hypot(*graph.nodes[n]), n)):
        if len(chosen) < 3 and all(math.dist(graph.nodes[node], graph.nodes[other]) > 95 for other in chosen):
            chosen.append(node)
    return frozenset(chosen)


def with_parking(plan: RoadPlan, parking_m: Mapping[str, float]) -> RoadPlan:
    """A plan whose roads are wider by their parking lanes, given by the id of the road."""
    return replace(plan, roads=tuple(replace(road, parking_m=parking_m.get(road.id, 0.0)) for road in plan.roads))


def write_plain(plan: RoadPlan, folder: Path, shift: Coordinate) -> tuple[Path, Path]:
    """SUMO's plain XML of a town, moved by `shift` metres: the files of nodes and of edges."""
    dx, dy = shift
    nodes, edges = folder / "town.nod.xml", folder / "town.edg.xml"
    degree = {node: sum(node in (road.start, road.end) for road in plan.roads) for node in plan.nodes}
    lines = ["<nodes>"]
    for node, (x, y) in plan.nodes.items():
        kind = "traffic_light" if node in plan.signals else "priority"
        radius = 6.0 if degree[node] > 2 else 4.0
        lines.append(f'  <node id="j{node}" x="{x + dx:.2f}" y="{y + dy:.2f}" type="{kind}" radius="{radius}"/>')
    nodes.write_text("\n".join([*lines, "</nodes>", ""]), encoding="utf-8")
    lines = ["<edges>"]
    for road in plan.roads:
        line = road.centre_line
        if road.one_way:  # SUMO places lanes to the right of an edge's line; the left sidewalk is an edge of its own
            line = LineString(line.offset_curve(road.carriageway_m / 2).coords)
        lines.append(_edge(road, road.id, road.start, road.end, line, shift))
        lines.append(_edge(road, f"-{road.id}", road.end, road.start, line.reverse(), shift, walked=road.one_way))
    edges.write_text("\n".join([*lines, "</edges>", ""]), encoding="utf-8")
    return nodes, edges


def _edge(
    road: Road, edge_id: str, start: int, end: int, line: LineString, shift: Coordinate, *, walked: bool = False
) -> str:
    """One direction of a road; `walked` when it has only a sidewalk."""
    shape = " ".join(f"{x + shift[0]:.2f},{y + shift[1]:.2f}" for x, y in line.coords)
    if walked:
        lanes = f'numLanes="1" width="{road.sidewalk_m}" allow="pedestrian"'
    else:
        lanes = f'numLanes="{road.lanes}" width="{road.lane_width_m}" sidewalkWidth="{road.sidewalk_m}" {_NO_RAILS}'
    return (
        f'  <edge id={quoteattr(edge_id)} name={quoteattr(road.name)} from="j{start}" to="j{end}" '
        f'priority="{road.rank.value}" speed="{road.speed_limit_mps}" {lanes} shape="{shape}"/>'
    )
