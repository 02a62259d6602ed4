"""A SUMO network as typed values: edges with lanes, junctions, crossings, connections and traffic lights.

It is the only reader of a world's network. Requests and signal programs are not read. Coordinates are
metres in the network's frame, which is the world frame.

A connection's line follows SUMO's internal lanes. A left turn that waits inside the junction has two of them in
sequence.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ParseError, iterparse

from shapely import LineString, Polygon

from pavetwin.errors import PaveTwinError
from pavetwin.world.model import Connection, Crossing, Direction, Junction, Lane, LaneKind, SignalLink

Points = list[tuple[float, float]]

DIRECTIONS: Final[Mapping[str, Direction]] = {
    "s": Direction.STRAIGHT,
    "l": Direction.LEFT,
    "r": Direction.RIGHT,
    "L": Direction.PARTLY_LEFT,
    "R": Direction.PARTLY_RIGHT,
    "t": Direction.TURNAROUND,
    "T": Direction.TURNAROUND,  # in left-hand traffic
}
"""SUMO's letters; any other is unknown."""


class ConnectionReader:
    """Collects the connections of a network, element by element."""

    def __init__(self) -> None:
        self._lanes: dict[tuple[str, int], str] = {}
        """(edge, index) → id, of all lanes, internal ones included."""
        self._inner_shapes: dict[str, Points] = {}
        """Internal lane → its points."""
        self._inner_edges: set[str] = set()
        """Internal edges, crossings and walking areas."""
        self._rows: list[dict[str, str]] = []
        self.crossing_signals: dict[str, SignalLink] = {}
        """Crossing → the signal for its pedestrians."""

    def take_edge(self, element: Element) -> None:
        """Note the lanes of an `<edge>` of any function.

        Raises:
            KeyError: an attribute is missing.
            ValueError: two lanes have one index, or a number is malformed.
        """
        edge = element.attrib["id"]
        function = element.get("function") or "normal"
        if function != "normal":
            self._inner_edges.add(edge)
        for lane in element.iter("lane"):
            place = edge, int(lane.attrib["index"])
            if place in self._lanes:
                both = f"'{self._lanes[place]}' and '{lane.attrib['id']}'"
                raise ValueError(f"the lanes {both} of the edge '{edge}' have one index, {place[1]}")
            self._lanes[place] = lane.attrib["id"]
            if function == "internal":
                self._inner_shapes[lane.attrib["id"]] = points_of(lane.attrib["shape"])

    def take_connection(self, element: Element) -> None:
        """Record a `<connection>`.

        Raises:
            KeyError: an attribute is missing.
            ValueError: a number is not one.
        """
        self._rows.append(dict(element.attrib))
        if element.get("tl") and element.attrib["to"] in self._inner_edges:
            self.crossing_signals[element.attrib["to"]] = _signal(element.attrib)

    def result(self, lanes: Iterable[Lane]) -> tuple[Connection, ...]:
        """The connections between the given lanes, in the file's order; others are left out.

        Raises:
            ValueError: a connection names an unknown lane.
        """
        kept = {lane.id: lane for lane in lanes}
        inner = [row for row in self._rows if row["from"] in self._inner_edges and "via" in row]
        following = {self._lane(row, "from"): row["via"] for row in inner}
        found: list[Connection] = []
        for row in self._rows:
            if row["from"] in self._inner_edges or row["to"] in self._inner_edges:
                continue
            start, end = kept.get(self._lane(row, "from")), kept.get(self._lane(row, "to"))
            if start is None or end is None:
                continue
            via = row.get("via", "")
            found.append(
                Connection(
                    from_lane=start.id,
                    to_lane=end.id,
                    direction=DIRECTIONS.get(row.get("dir", ""), Direction.UNKNOWN),
                    signal=_signal(row) if row.get("tl") else None,
                    via=via,
                    centre_line=self._line(start, tuple(_chain(via, following)), end),
                )
            )
        return tuple(found)

    def _lane(self, row: Mapping[str, str], end: str) -> str:
        place = row[end], int(row[f"{end}Lane"])
        if place not in self._lanes:
            raise ValueError(
                f"a connection leads {end} lane {place[1]} of the edge '{place[0]}', and there is no such lane"
            )
        return self._lanes[place]

    def _line(self, start: Lane, inner: tuple[str, ...], end: Lane) -> LineString:
        points = [start.centre_line.coords[-1]]
        for lane in inner:
            if lane not in self._inner_shapes:
                raise ValueError(f"the connection from '{start.id}' to '{end.id}' runs over '{lane}', not a lane")
            points += self._inner_shapes[lane]
        points.append(end.centre_line.coords[0])
        apart = [point for point, _ in groupby(points)]
        return LineString(apart if len(apart) > 1 else apart * 2)


def _chain(via: str, following: Mapping[str, str]) -> Iterator[str]:
    """An internal lane and those that follow it until the junction ends."""
    seen: set[str] = set()
    while via and via not in seen:
        seen.add(via)
        yield via
        via = following.get(via, "")


def _signal(attributes: Mapping[str, str]) -> SignalLink:
    return SignalLink(attributes["tl"], int(attributes["linkIndex"]))


def points_of(shape: str) -> Points:
    """The points (x, y) of a `shape` attribute, without repetitions and heights."""
    pairs = (point.split(",")[:2] for point in shape.split())
    return [point for point, _ in groupby((float(x), float(y)) for x, y in pairs)]


DEFAULT_LANE_WIDTH_M = 3.2
"""SUMO's width of a lane without one of its own [m]."""

PARKING_LANE = "parking"
"""The `type` of a lane that no traffic may use because one parks there."""

MOTOR = frozenset({"passenger", "private", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle"})
"""SUMO vehicle classes for which a lane counts as part of the carriageway's driving lanes."""


@dataclass(frozen=True, slots=True)
class Edge:
    """A directed edge between two junctions; its lanes begin at the kerb."""

    id: str
    start: str
    end: str
    name: str
    type: str
    lanes: tuple[Lane, ...]
    for_cars: bool
    """Passenger cars may use it."""

    @property
    def carriageway(self) -> tuple[Lane, ...]:
        """Driving, bicycle and parking lanes, from the kerb to the middle of the street."""
        return tuple(lane for lane in self.lanes if lane.kind is not LaneKind.SIDEWALK)

    @property
    def speed_limit_mps(self) -> float:
        """The highest limit of its carriageway; infinite without one."""
        return max((lane.speed_limit_mps for lane in self.carriageway), default=math.inf)

    @property
    def sidewalk_width_m(self) -> float:
        """Width of the sidewalks along its carriageway, 0 when it has none."""
        return sum(lane.width_m for lane in self.lanes if lane.kind is LaneKind.SIDEWALK)


@dataclass(frozen=True, slots=True)
class RoadNet:
    edges: dict[str, Edge]
    junctions: tuple[Junction, ...]
    crossings: tuple[Crossing, ...]
    connections: tuple[Connection, ...]
    """Between the lanes of the edges."""
    signalled: dict[str, str]
    """Edge → the SUMO traffic light at its end."""
    location: dict[str, str]
    """The attributes of `<location>`."""
    left_hand: bool


def read_roadnet(path: Path, shown_as: str | None = None) -> RoadNet:
    """Read a `.net.xml`; `shown_as` names it in messages when it is a temporary copy.

    Raises:
        PaveTwinError: it is not readable, no XML, or no SUMO network.
    """
    shown = shown_as or str(path)
    reader = _NetReader()
    depth = 0
    try:
        for event, element in iterparse(path, events=("start", "end")):
            depth += 1 if event == "start" else -1
            if event == "start" and depth == 1:
                if element.tag != "net":
                    raise PaveTwinError(f"'{shown}' is not a SUMO network: it begins with <{element.tag}>, not <net>.")
                reader.left_hand = element.get("lefthand") in ("1", "true")
            elif event == "end" and depth == 1:
                reader.take(element)
                element.clear()
        return reader.result()
    except ParseError as error:
        raise PaveTwinError(
            f"'{shown}' is not readable as XML ({error}); it may be cut short: fetch or convert it again."
        ) from error
    except OSError as error:
        raise PaveTwinError(f"Cannot read '{shown}': {error.strerror or error}.") from error
    except (KeyError, ValueError) as error:
        raise PaveTwinError(
            f"'{shown}' is not a complete SUMO network ({error}); generate it again with netconvert."
        ) from error


class _NetReader:
    def __init__(self) -> None:
        self.left_hand = False
        self.edges: dict[str, Edge] = {}
        self.connections = ConnectionReader()
        self.junctions: list[Junction] = []
        self.crossings: list[tuple[str, Polygon]] = []
        self.signalled: dict[str, str] = {}
        self.location: dict[str, str] = {}

    def take(self, element: Element) -> None:
        match element.tag:
            case "location":
                self.location = dict(element.attrib)
            case "edge":
                self.connections.take_edge(element)
                self._take_edge(element)
            case "junction" if element.get("type") != "internal":
                self._take_junction(element)
            case "connection":
                self.connections.take_connection(element)
                if controller := element.get("tl"):
                    self.signalled[element.attrib["from"]] = controller

    def _take_edge(self, element: Element) -> None:
        match element.get("function") or "normal":
            case "normal":
                edge = _edge(element)
                self.edges[edge.id] = edge
            case "crossing":
                self.crossings += _crossing(element)

    def _take_junction(self, element: Element) -> None:
        corners = points_of(element.get("shape", ""))
        if len(corners) < 3:
            return
        polygon = Polygon(corners).buffer(0)
        parts = getattr(polygon, "geoms", [polygon])
        largest = max(parts, key=lambda part: part.area, default=polygon)
        if largest.area >= 0.5:
            self.junctions.append(Junction(element.attrib["id"], element.attrib["type"], largest))

    def result(self) -> RoadNet:
        signals = self.connections.crossing_signals
        return RoadNet(
            edges=self.edges,
            junctions=tuple(self.junctions),
            crossings=tuple(Crossing(name, polygon, signals.get(name)) for name, polygon in self.crossings),
            connections=self.connections.result(lane for edge in self.edges.values() for lane in edge.lanes),
            signalled={edge: light for edge, light in self.signalled.items() if edge in self.edges},
            location=self.location,
            left_hand=self.left_hand,
        )


def _crossing(element: Element) -> Iterator[tuple[str, Polygon]]:
    for lane in element.iter("lane"):
        points = points_of(lane.attrib["shape"])
        if len(points) < 2:
            continue
        width = float(lane.get("width", "4"))
        polygon = LineString(points).buffer(width / 2, cap_style="flat", join_style="mitre")
        if isinstance(polygon, Polygon) and polygon.area > 0:
            yield element.attrib["id"], polygon


def _edge(element: Element) -> Edge:
    name = element.attrib["id"]
    lanes = []
    for_cars = False
    for lane in element.iter("lane"):
        kind = _kind(lane.attrib)
        for_cars = for_cars or _allows(lane.attrib, "passenger")
        points = points_of(lane.attrib["shape"])
        if kind is None or len(points) < 2:
            continue
        lanes.append(
            Lane(
                id=lane.attrib["id"],
                edge=name,
                index=int(lane.attrib["index"]),
                kind=kind,
                centre_line=LineString(points),
                width_m=float(lane.get("width", str(DEFAULT_LANE_WIDTH_M))),
                speed_limit_mps=float(lane.attrib["speed"]),
            )
        )
    return Edge(
        id=name,
        start=element.attrib["from"],
        end=element.attrib["to"],
        name=element.get("name", "").strip(),
        type=element.get("type", ""),
        lanes=tuple(sorted(lanes, key=lambda lane: lane.index)),
        for_cars=for_cars,
    )


def _allows(lane: Mapping[str, str], vehicle_class: str) -> bool:
    """Whether a lane's `allow`, or else its `disallow`, lets a vehicle class in."""
    named = {vehicle_class, "all"}
    if (allow := lane.get("allow")) is not None:
        return not named.isdisjoint(allow.split())
    return named.isdisjoint(lane.get("disallow", "").split())


def is_driven(attributes: Mapping[str, str]) -> bool:
    """Whether any motor vehicle of the road may use a lane with these attributes."""
    return any(_allows(attributes, vehicle_class) for vehicle_class in MOTOR)


def is_walked(attributes: Mapping[str, str]) -> bool:
    """Whether pedestrians and no motor vehicles may use a lane with these attributes."""
    return _allows(attributes, "pedestrian") and not is_driven(attributes)


def _kind(attributes: Mapping[str, str]) -> LaneKind | None:
    """Driving when any motor vehicle of the road may use it; rails and forbidden lanes are none, but for those whose
    type is `parking`."""
    if is_driven(attributes):
        return LaneKind.DRIVING
    if _allows(attributes, "bicycle"):
        return LaneKind.BICYCLE
    if _allows(attributes, "pedestrian"):
        return LaneKind.SIDEWALK
    return LaneKind.PARKING if attributes.get("type") == PARKING_LANE else None
