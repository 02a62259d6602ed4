"""The network for the demand: where vehicles start and end, and how sidewalks are connected.

It is read from the running simulation, in the simulation's process. Which lanes belong to which edge, and in which
order, comes from the world.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.world.groups import groups

SIDE_STREET_SPEED_MPS: Final = 14.0
"""Up to 50 km/h (13.89 m/s) and with one lane: a street where a parked car may depart."""

SHORTEST_START_M: Final = 15.0
"""Shorter edges are not kerbside starts: a bus must fit."""


@dataclass(frozen=True, slots=True)
class Roads:
    """The edges that cars may use, in the network's order."""

    ids: tuple[str, ...]
    length_m: Float64Array
    """(n,) length times driving lanes."""
    lanes: Int64Array
    """(n,) driving lanes: the traffic of an entry or exit is in proportion to them."""
    entries: Int64Array
    """Indices of edges that begin at the map's border or in a dead end."""
    exits: Int64Array
    """Indices of edges that end there."""
    kerbsides: Int64Array
    """Indices of side streets, where parked vehicles may depart; all edges where there are none."""


@dataclass(frozen=True, slots=True)
class Sidewalks:
    """The edges with a sidewalk, and which ends meet over walking areas and crossings."""

    ids: tuple[str, ...]
    length_m: Float64Array
    """(n,)"""
    ends: tuple[tuple[int, int], ...]
    """Per sidewalk, the meeting places at its beginning and end; −1 where there is none."""
    meetings: tuple[tuple[int, ...], ...]
    """Per meeting place, the sidewalks that can be reached on foot from each other there."""


def read_roads(sumo: Any, lanes_of: Mapping[str, Sequence[str]], area: Set[str] | None = None) -> Roads:
    """The driving edges of the running simulation `sumo` (the libsumo module); `lanes_of` as in `SimulationJob`.

    Args:
        area: the edges to read, whose border is where ways lead to others; None for all.
    """
    ids: list[str] = []
    length, lanes, speed = [], [], []
    following: dict[str, set[str]] = {}
    for edge in _edges(sumo, lanes_of, area):
        driving = [lane for lane in lanes_of[edge] if _allows(sumo, lane, "passenger")]
        if not driving:
            continue
        ids.append(edge)
        lanes.append(len(driving))
        length.append(float(sumo.lane.getLength(driving[0])))
        speed.append(float(sumo.lane.getMaxSpeed(driving[0])))
        following[edge] = {sumo.lane.getEdgeID(link[0]) for lane in driving for link in sumo.lane.getLinks(lane)}
    ends = {edge: (sumo.edge.getFromJunction(edge), sumo.edge.getToJunction(edge)) for edge in ids}
    if area is not None:
        following = {edge: others.intersection(area) for edge, others in following.items()}
    onward = {edge: [other for other in following[edge] if ends.get(other) != ends[edge][::-1]] for edge in ids}
    reached = {other for edge in ids for other in onward[edge]}
    length_m, count = np.array(length), np.array(lanes, dtype=np.int64)
    slow = (np.array(speed) <= SIDE_STREET_SPEED_MPS) & (count == 1) & (length_m >= SHORTEST_START_M)
    if not slow.any():
        slow = np.ones(len(ids), dtype=bool)
    return Roads(
        ids=tuple(ids),
        length_m=length_m * count,
        lanes=count,
        entries=np.array([i for i, edge in enumerate(ids) if edge not in reached], dtype=np.int64),
        exits=np.array([i for i, edge in enumerate(ids) if not onward[edge]], dtype=np.int64),
        kerbsides=np.flatnonzero(slow),
    )


def read_sidewalks(sumo: Any, lanes_of: Mapping[str, Sequence[str]], area: Set[str] | None = None) -> Sidewalks:
    """The sidewalks of the running simulation `sumo`, and where they meet; the arguments as of `read_roads`."""
    ids, length = [], []
    touching: list[tuple[str, str]] = []
    walks: list[str] = []
    for edge in _edges(sumo, lanes_of, area):
        walk = next(
            (x for x in lanes_of[edge] if _allows(sumo, x, "pedestrian") and not _allows(sumo, x, "passenger")), None
        )
        if walk is not None:
            ids.append(edge)
            walks.append(walk)
            length.append(float(sumo.lane.getLength(walk)))
    paths = _paths(sumo, lanes_of)
    for lane in (*walks, *paths):
        touching.extend((lane, link[0]) for link in sumo.lane.getLinks(lane))
    known = set(paths)
    on_paths = [pair for pair in touching if known.issuperset(pair)]
    inside = groups([*((lane,) for lane in paths), *on_paths])
    first, last = dict.fromkeys(walks, ""), dict.fromkeys(walks, "")
    for a, b in touching:
        if a in last and b in inside:
            last[a] = inside[b]
        elif b in first and a in inside:
            first[b] = inside[a]
    number = {name: i for i, name in enumerate(sorted({*first.values(), *last.values()} - {""}))}
    ends = tuple((number.get(first[lane], -1), number.get(last[lane], -1)) for lane in walks)
    members: dict[int, list[int]] = defaultdict(list)
    for i, pair in enumerate(ends):
        for meeting in set(pair) - {-1}:
            members[meeting].append(i)
    return Sidewalks(
        ids=tuple(ids),
        length_m=np.array(length),
        ends=ends,
        meetings=tuple(tuple(members[i]) for i in range(len(number))),
    )


def islands(sumo: Any, edges: Set[str]) -> list[frozenset[str]]:
    """The parts of an area between which no way leads inside it, in the simulation's order."""
    here = [edge for edge in sumo.edge.getIDList() if edge in edges]
    ends = {edge: (f"at {sumo.edge.getFromJunction(edge)}", f"at {sumo.edge.getToJunction(edge)}") for edge in here}
    group = groups((edge, *ends[edge]) for edge in here)
    return [frozenset(edge for edge in here if group[edge] == name) for name in dict.fromkeys(map(group.get, here))]


def close_others(sumo: Any, lanes_of: Mapping[str, Sequence[str]], area: Set[str]) -> None:
    """Let no vehicle drive outside an area, so that no route leads there."""
    for edge in _edges(sumo, lanes_of):
        for lane in () if edge in area else lanes_of[edge]:
            if _allows(sumo, lane, "passenger"):
                sumo.lane.setDisallowed(lane, ["all"])


def signals_in(sumo: Any, lanes_of: Mapping[str, Sequence[str]], area: Set[str]) -> list[str]:
    """The traffic lights that control a way out of a lane in an area."""
    lanes = {lane for edge in area for lane in lanes_of[edge]}
    lights = sumo.trafficlight
    return [name for name in lights.getIDList() if not lanes.isdisjoint(lights.getControlledLanes(name))]


def _edges(sumo: Any, lanes_of: Mapping[str, Sequence[str]], area: Set[str] | None = None) -> list[str]:
    """The world's edges, or those of an area, in the simulation's order."""
    return [edge for edge in sumo.edge.getIDList() if edge in (lanes_of if area is None else area)]


def _paths(sumo: Any, lanes_of: Mapping[str, Sequence[str]]) -> list[str]:
    """The lanes of crossings and walking areas: inside a junction, on foot, and no internal lane of a connection."""
    lanes = sumo.lane.getIDList()
    others = {link[4] for lane in lanes for link in sumo.lane.getLinks(lane)}.union(*lanes_of.values())
    return [lane for lane in lanes if lane not in others and _allows(sumo, lane, "pedestrian")]


def _allows(sumo: Any, lane: str, sumo_class: str) -> bool:
    allowed = sumo.lane.getAllowed(lane)
    return not allowed or sumo_class in allowed
