"""Closed-loop demand: every simulated second, agents are inserted up to the target number.

Vehicles enter at the map's border and at dead ends while these have room; only the remainder departs at the kerb of
side streets, so that few vehicles appear in mid-street. A trip leads to a random exit (any edge, in a network without
exits) and is at least `TRIP_M` long where the network is large enough. At a density it leads to the fastest of
`GOALS` of them; such trips keep out of each other's way, so that flow hardly falls in dense traffic. Where a level of
service or an hour is requested, no exit is preferred. Vehicles are rerouted (SUMO's rerouting device) by travel times
that are means over up to half an hour. Pedestrians start on any sidewalk, walk at random over crossings and end on a
sidewalk. During the first half of the warm-up agents start anywhere. Runs only in the simulation's process.

The network comes from the running simulation; the lanes of each edge, in their order, come from the world.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.traffic.kinds import PEDESTRIANS
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
    """The sidewalks of the running simulation `sumo`, and their connections; arguments as in `read_roads`."""
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


TRIP_M: Final = 400.0
"""Minimum length of a vehicle's trip, where a goal is that far away."""

WALK_M: Final = (250.0, 900.0)
"""Range of the length of a walk: most walks in towns last 3 to 12 minutes."""

GOALS: Final = 6
"""Random goals considered for a trip."""

PATIENCE: Final = 0.04
"""Share of vehicles that may be missing before vehicles depart at the kerb although the border has room."""

PRESENT_TIMES: Final = 1
"""SUMO's routing mode that looks at past travel times (ROUTING_MODE_AGGREGATED): means of up to 180 adaptation
intervals, from those of empty streets on."""

JAM_LENGTH_M: Final = 7.5
"""Road length of one stopped vehicle."""

FULL: Final = 0.7
"""No vehicle departs on an edge with at least this occupancy."""


class ClosedLoop:
    """Holds the numbers of vehicles and pedestrians in the running simulation `sumo` (the libsumo module)."""

    def __init__(
        self,
        sumo: Any,
        roads: Roads,
        sidewalks: Sidewalks,
        vehicles: int,
        pedestrians: int,
        rng: np.random.Generator,
        types: Sequence[tuple[str, float]],
        *,
        fastest_goals: bool = True,
        prefix: str = "",
    ) -> None:
        """
        Args:
            types: SUMO's, of the vehicles, with their shares.
            prefix: of the ids of its agents, where several loops hold a part of the network each.
        """
        self._sumo = sumo
        self._prefix = prefix
        self._roads = roads
        self._sidewalks = sidewalks
        self._vehicles = vehicles if roads.ids else 0
        self._pedestrians = pedestrians if sidewalks.ids else 0
        self._fastest_goals = fastest_goals
        self._rng = rng
        self._count = 0
        self._anywhere = Draw(roads.length_m)
        self._entry = Draw(roads.lanes[roads.entries])
        self._exit = Draw(roads.lanes[roads.exits])
        self._kerb = Draw(roads.length_m[roads.kerbsides])
        self._sidewalk = Draw(sidewalks.length_m)
        self._vehicle_types, shares = zip(*types, strict=True)
        self._vehicle_type = Draw(np.array(shares))
        self._pedestrian_kind = Draw(np.array([kind.share for kind in PEDESTRIANS]))

    def hold(self, vehicles: int) -> None:
        """Hold another number of vehicles from now on."""
        self._vehicles = vehicles if self._roads.ids else 0

    def fill(self, *, warming: bool) -> None:
        """Insert the missing agents; `warming` before the recording begins."""
        sumo = self._sumo
        missing = self._vehicles - self._own(sumo.vehicle) - self._counted(sumo.simulation.getPendingVehicles())
        if warming:
            for _ in range(missing):
                self._start_anywhere()
        elif missing > 0:
            left = missing - self._start_at_border(missing)
            if missing > PATIENCE * self._vehicles or not len(self._roads.entries):
                for _ in range(left):
                    self._start_at_kerb()
        for _ in range(self._pedestrians - self._own(sumo.person)):
            self._start_walk()

    def _own(self, domain: Any) -> int:
        """Number of SUMO's vehicles or persons that are its own."""
        return self._counted(domain.getIDList()) if self._prefix else int(domain.getIDCount())

    def _counted(self, names: Sequence[str]) -> int:
        return sum(name.startswith(self._prefix) for name in names) if self._prefix else len(names)

    def _start_at_border(self, missing: int) -> int:
        """Start vehicles on entries with room, at most one a lane; returns how many."""
        roads, started = self._roads, 0
        if not len(roads.entries):
            return 0
        for _ in range(min(missing, len(roads.entries))):
            edge = int(roads.entries[self._entry(self._rng)])
            if self._occupied(edge) < FULL:
                self._start(edge, departPos="base", departLane="free", departSpeed="max")
                started += 1
        return started

    def _start_at_kerb(self) -> None:
        edge = self._with_room(self._roads.kerbsides, self._kerb)
        self._start(edge, departPos="random_free", departLane="first", departSpeed="0")

    def _start_anywhere(self) -> None:
        edge = self._with_room(None, self._anywhere)
        self._start(edge, departPos="random_free", departLane="random", departSpeed="max")

    def _with_room(self, edges: Any, draw: "Draw") -> int:
        """An edge drawn in proportion to its free lane length."""
        for _ in range(8):
            picked = draw(self._rng)
            edge = int(edges[picked]) if edges is not None else picked
            if self._rng.random() >= self._occupied(edge) / FULL:
                return edge
        return edge

    def _occupied(self, edge: int) -> float:
        count = self._sumo.edge.getLastStepVehicleNumber(self._roads.ids[edge])
        return float(count * JAM_LENGTH_M / self._roads.length_m[edge])

    def _start(self, edge: int, **departure: str) -> None:
        """Insert a vehicle of a random type at `edge`, unless its type may not drive there."""
        sumo, type_id = self._sumo, self._vehicle_types[self._vehicle_type(self._rng)]
        route = self._trip(edge, type_id)
        if not route:
            return
        name = f"{self._prefix}v{self._count}"
        self._count += 1
        sumo.route.add(name, route)
        sumo.vehicle.add(name, name, typeID=type_id, **departure)

    def _trip(self, start: int, type_id: str) -> Sequence[str]:
        """The route from `start`, fastest by past travel times, to a random goal, preferably at least `TRIP_M` away.

        With `fastest_goals` it is that of `GOALS` goals with the highest mean speed, else the first that is far enough.
        """
        roads, find = self._roads, self._sumo.simulation.findRoute
        best, merit = (), (False, -1.0)
        for _ in range(GOALS):
            goal = int(roads.exits[self._exit(self._rng)]) if len(roads.exits) else self._anywhere(self._rng)
            stage = find(roads.ids[start], roads.ids[goal], type_id, -1.0, PRESENT_TIMES)
            if stage.edges:
                far = stage.length >= TRIP_M
                if far and not self._fastest_goals:
                    return tuple(stage.edges)
                this = (far, stage.length / max(stage.travelTime, 1.0) if far else stage.length)
                if this > merit:
                    best, merit = stage.edges, this
        return best

    def _start_walk(self) -> None:
        walks = self._sidewalks
        start = self._sidewalk(self._rng)
        edges = self._walk(start)
        kind = PEDESTRIANS[self._pedestrian_kind(self._rng)]
        name = f"{self._prefix}p{self._count}"
        self._count += 1
        place = self._rng.random() * walks.length_m[start]
        goal = self._rng.random() * walks.length_m[edges[-1]] if len(edges) > 1 else -1.0
        self._sumo.person.add(name, walks.ids[start], float(place), typeID=kind.sumo_id)
        self._sumo.person.appendWalkingStage(name, [walks.ids[i] for i in edges], float(goal))

    def _walk(self, start: int) -> list[int]:
        """Sidewalks from `start` on, each reached on foot from the one before, until the walk is long enough."""
        walks, rng = self._sidewalks, self._rng
        enough_m = rng.uniform(*WALK_M)
        route, length = [start], walks.length_m[start] / 2
        side = int(rng.integers(2))
        if walks.ends[start][side] < 0:
            side = 1 - side
        while length < enough_m:
            here = route[-1]
            meeting = walks.ends[here][side]
            ways = [i for i in walks.meetings[meeting] if i != here] if meeting >= 0 else []
            if not ways:
                break
            there = ways[int(rng.integers(len(ways)))]
            route.append(there)
            length += walks.length_m[there]
            side = 1 if walks.ends[there][0] == meeting else 0
        return route


class Draw:
    """Indices in proportion to fixed weights."""

    def __init__(self, weights: npt.ArrayLike) -> None:
        self._cumulated = np.cumsum(np.asarray(weights, dtype=np.float64))

    def __call__(self, rng: np.random.Generator) -> int:
        picked = np.searchsorted(self._cumulated, rng.random() * self._cumulated[-1], side="right")
        return min(int(picked), len(self._cumulated) - 1)
