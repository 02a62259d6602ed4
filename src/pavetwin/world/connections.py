"""Connections of a SUMO network: from lane to lane across its junctions, with their turns and signal links.

A connection's line follows SUMO's internal lanes. A left turn that waits inside the junction has two of them in
sequence.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import Final
from xml.etree.ElementTree import Element

from shapely import LineString

from pavetwin.world.model import Connection, Direction, Lane, SignalLink

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
            ValueError: two lanes have one index, or a number is not one.
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
        """Note a `<connection>`.

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
