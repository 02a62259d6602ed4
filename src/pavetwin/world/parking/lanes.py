"""Parking lanes: which streets get them, how wide they are, and the effect on the adjacent lanes.

A street that is parked on has a lane along its kerb that is not driven on, between its sidewalk and its driving lanes.
Where the map has the width from kerb to kerb, its driving lanes are narrowed for it; without one, or where they would
become too narrow, the carriageway is widened.

They are inserted into a SUMO network by way of netconvert's plain XML: plain files of nodes, edges, connections and
traffic lights. Edges get their lanes there, connections and links of signals keep their lanes, and netconvert makes the
network again. Ids, names, turns, crossings and signal programs stay; kerbs, junctions and crossings get the shapes of
the wider streets.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ElementTree, parse

import shapely
from shapely import LineString, Polygon, STRtree

from pavetwin.world.model import Building, Lane, LaneKind, Segment
from pavetwin.world.network import copy_without_stamp
from pavetwin.world.parking.kerbs import Kerb, WayIndex, depth_m, kerbs_of, lane_depth_m
from pavetwin.world.parking.mapped import ParkingMap
from pavetwin.world.parking.places import parking_places
from pavetwin.world.parking.rule import ParkingRule
from pavetwin.world.roadnet import PARKING_LANE, RoadNet, is_driven, is_walked
from pavetwin.world.segments import StreetSurface
from pavetwin.world.sumo import NO_VALIDATION, run_tool

LEAST_LANE_M: Final = 2.5
"""Driving lanes along parked vehicles are not narrowed further [m]. Ours: the widest vehicle of the mixes is 2.55 m,
most are below 2 m."""

HOUSE_CLEARANCE_M: Final = 0.3
"""A carriageway is not widened to within this of a building [m]."""

OVER_STREET_SHARE: Final = 0.1
"""A carriageway is not widened where this share of what is added would lie on another street."""


@dataclass(frozen=True, slots=True)
class EdgeLanes:
    """Widths of a directed edge with the parking lanes of its street."""

    kerb_m: float = 0.0
    """Width of the parking lane between its sidewalk and its driving lanes; 0 for none."""
    far_m: float = 0.0
    """Width of the lane at the opposite kerb of a one-way street."""
    driving_m: tuple[float, ...] = ()
    """Widths of its driving lanes, from the kerb to the middle."""
    centred: bool = False
    """Whether the line of the street is the middle of its carriageway with its parking lanes. The two directions are
    of different widths then."""


def parking_lanes(
    net: RoadNet,
    streets: Sequence[StreetSurface],
    segments: Sequence[Segment],
    buildings: Sequence[Building],
    mapped: ParkingMap,
    rule: ParkingRule,
    houses: Sequence[Polygon] = (),
) -> dict[str, EdgeLanes]:
    """The edges of a network without parking lanes that are to be changed, in the order of its streets.

    A kerb gets a lane if at least one place lies on the carriageway there; the lane is as wide as the deepest of them.
    It does not get one where the wider street would run into a house or over another street.

    Args:
        houses: that stay where they are.
    """
    depths: dict[tuple[str, str], float] = {}
    for place in parking_places(net, streets, segments, buildings, (), mapped, rule, planned=True):
        depth = round(lane_depth_m(place.position, depth_m(rule.places[place.orientation])), 2)
        if depth > 0.0:
            at = place.edge, place.side
            depths[at] = max(depth, depths.get(at, 0.0))
    ways = WayIndex(mapped.ways)
    surroundings = _Surroundings(net, streets, houses)
    by_street: dict[str, list[Kerb]] = {}
    for kerb in kerbs_of(streets, net.left_hand):
        if (kerb.edge, kerb.side) in depths:
            by_street.setdefault(kerb.street.street.id, []).append(kerb)
    changed: dict[str, EdgeLanes] = {}
    for kerbs in by_street.values():
        width = _mapped_width_m(kerbs[0], ways)
        for sides in (kerbs, *([kerb] for kerb in kerbs[: len(kerbs) // 2 * 2])):
            section = _Section(sides, [depths[kerb.edge, kerb.side] for kerb in sides], width, rule)
            if all(surroundings.have_room(kerb, growth) for kerb, growth in section.growths_m()):
                changed |= section.edges(net.left_hand)
                break
    return changed


def _mapped_width_m(kerb: Kerb, ways: WayIndex) -> float | None:
    """Width from kerb to kerb, of the way that runs along most of it."""
    along: dict[float | None, float] = {}
    for stretch in ways.stretches(kerb):
        width = stretch.way.width_m if stretch.way else None
        along[width] = along.get(width, 0.0) + stretch.end_m - stretch.start_m
    return max(along, key=lambda width: along[width])


class _Section:
    """The cross-section of a street with parking lanes of some depths along some kerbs."""

    def __init__(
        self, kerbs: Sequence[Kerb], depths: Sequence[float], mapped_m: float | None, rule: ParkingRule
    ) -> None:
        self._parked = tuple(zip(kerbs, depths, strict=True))
        self._edges = kerbs[0].street.edges
        lanes = [lane for edge in self._edges for lane in edge.carriageway]
        self._before_m = sum(lane.width_m for lane in lanes)
        driving = sum(lane.width_m for lane in lanes if lane.kind is LaneKind.DRIVING)
        passage = rule.of_street(kerbs[0].street.street.kind).passage_m
        room = driving if mapped_m is None else mapped_m - sum(depths) - (self._before_m - driving)
        self._share = min(1.0, max(room, passage) / driving)
        self._after_m = sum(depths) + sum(self._width_m(lane) for lane in lanes)
        symmetrical = len(kerbs) == 2 and depths[0] == depths[1]
        self._centred = len(self._edges) == 1 or (mapped_m is not None and not symmetrical)

    def _width_m(self, lane: Lane) -> float:
        if lane.kind is not LaneKind.DRIVING:
            return lane.width_m
        return round(min(lane.width_m, max(LEAST_LANE_M, lane.width_m * self._share)), 2)

    def growths_m(self) -> Iterator[tuple[Kerb, float]]:
        """Outward move of each kerb with a parking lane."""
        for kerb, depth in self._parked:
            beside = next(edge for edge in self._edges if edge.id == kerb.edge).carriageway
            alone = depth + sum(self._width_m(lane) - lane.width_m for lane in beside)
            yield kerb, (self._after_m - self._before_m) / 2 if self._centred else alone

    def edges(self, left_hand: bool) -> dict[str, EdgeLanes]:
        """Widths of the edges of both directions."""
        outer = 1 if left_hand else -1
        kerb_m = {kerb.edge: depth for kerb, depth in self._parked if kerb.outward == outer}
        far_m = {kerb.edge: depth for kerb, depth in self._parked if kerb.outward != outer}
        return {
            edge.id: EdgeLanes(
                kerb_m.get(edge.id, 0.0),
                far_m.get(edge.id, 0.0),
                tuple(self._width_m(lane) for lane in edge.carriageway if lane.kind is LaneKind.DRIVING),
                self._centred,
            )
            for edge in self._edges
        }


class _Surroundings:
    """Houses and other streets, into which no street is widened."""

    def __init__(self, net: RoadNet, streets: Sequence[StreetSurface], houses: Sequence[Polygon]) -> None:
        self._houses = STRtree(houses)
        self._streets = streets
        self._street_tree = STRtree([street.polygon for street in streets])
        self._crossed = shapely.union_all([junction.polygon for junction in net.junctions])

    def have_room(self, kerb: Kerb, growth_m: float) -> bool:
        """Whether a kerb can be moved outwards."""
        if growth_m <= 0.0:
            return True
        added = kerb.line.buffer(kerb.outward * growth_m, single_sided=True)
        if len(self._houses.query(added, predicate="dwithin", distance=HOUSE_CLEARANCE_M)):
            return False
        near = (self._streets[int(index)] for index in self._street_tree.query(added, predicate="intersects"))
        others = [street.polygon for street in near if street is not kerb.street]
        over = shapely.union_all(others).difference(self._crossed)
        return bool(added.intersection(over).area <= OVER_STREET_SHARE * added.area)


PLAIN_OPTIONS: Final = (
    "--walkingareas",
    "--no-turnarounds",  # the plain files hold those that there are
    "--offset.disable-normalization",
    "--output.street-names",
    "--no-warnings",
    *NO_VALIDATION,
)

NOBODY: Final = "custom1"
"""The vehicle class that parking lanes allow, which no vehicle has. To netconvert a lane that allows none at all is a
verge, on which pedestrians wait and which crossings do not cross."""

OF_LANES: Final = ("allow", "disallow", "width")
"""Attributes of an edge in plain XML that hold for each of its lanes."""


def insert_lanes(
    network: Path, changed: Mapping[str, EdgeLanes], target: Path, options: tuple[str, ...] = (), *, left_hand: bool
) -> None:
    """Write a network with parking lanes to `target`; `network` stays as it is.

    Args:
        options: further options of netconvert with which the network was made.

    Raises:
        PaveTwinError: netconvert failed, or SUMO is missing.
    """
    doing = "Cannot add parking lanes to the road network"
    prefix = target.with_name("plain")
    source = ("--sumo-net-file", str(network), "--plain-output-prefix", str(prefix))
    run_tool("netconvert", [*source, "--no-warnings", *NO_VALIDATION], doing=doing)
    files = {kind: Path(f"{prefix}.{kind}.xml") for kind in ("nod", "edg", "con", "tll", "typ")}
    _change_edges(files["edg"], changed, left_hand)
    inserted_at = {edge: lanes for edge, lanes in _sidewalks(files["edg"]).items() if edge in changed}
    for kind in ("con", "tll"):
        _shift_connections(files[kind], changed, inserted_at)
    made = target.with_name("with_lanes.net.xml")
    arguments = ["--node-files", str(files["nod"]), "--edge-files", str(files["edg"])]
    arguments += ["--connection-files", str(files["con"]), "--tllogic-files", str(files["tll"])]
    arguments += ["--output-file", str(made)]
    if files["typ"].is_file():  # where edges have types
        _forget_lanes_of_types(files["typ"])
        arguments += ["--type-files", str(files["typ"])]
    if left_hand:
        arguments.append("--lefthand")
    run_tool("netconvert", [*arguments, *PLAIN_OPTIONS, *options], doing=doing)
    copy_without_stamp(made, target)


def _forget_lanes_of_types(path: Path) -> None:
    """Types of edges without the sidewalks and bicycle lanes that netconvert would add to edges that have none."""
    tree = parse(path)
    for kind in tree.getroot().iter("type"):
        for key in ("sidewalkWidth", "bikeLaneWidth"):
            kind.attrib.pop(key, None)
    _write(tree, path)


def _sidewalks(edges: Path) -> dict[str, int]:
    """Number of lanes of each edge between its kerb and its border."""
    return {edge.attrib["id"]: _leading_sidewalks(edge) for edge in parse(edges).getroot().iter("edge")}


def _leading_sidewalks(edge: Element) -> int:
    lanes = edge.findall("lane")
    return next((number for number, lane in enumerate(lanes) if not is_walked(lane.attrib)), len(lanes))


def _change_edges(path: Path, changed: Mapping[str, EdgeLanes], left_hand: bool) -> None:
    tree = parse(path)
    by_id = {edge.attrib["id"]: edge for edge in tree.getroot().iter("edge")}
    for name, lanes in changed.items():
        edge = by_id[name]
        if lanes.far_m and edge.get("spreadType", "right") == "right":
            moved = lanes.far_m if not left_hand else -lanes.far_m
            _move(edge, moved)
            for other in by_id.values():
                if (other.get("from"), other.get("to")) == (edge.get("to"), edge.get("from")):
                    _move(other, -moved)
        elif lanes.centred and edge.get("spreadType", "right") == "right":
            edge.set("spreadType", "roadCenter")
        _with_lanes(edge, lanes)
    _write(tree, path)


def _move(edge: Element, left_m: float) -> None:
    """An edge whose line is the middle of its street, moved to the left."""
    points = [tuple(float(value) for value in point.split(",")[:2]) for point in edge.attrib["shape"].split()]
    moved = LineString(LineString(points).offset_curve(left_m).coords)
    edge.set("shape", " ".join(f"{x:.2f},{y:.2f}" for x, y in moved.coords))


def _with_lanes(edge: Element, changed: EdgeLanes) -> None:
    """Give an edge its parking lanes, and its driving lanes their widths."""
    shared = {key: edge.attrib.pop(key) for key in OF_LANES if key in edge.attrib}
    given = {int(lane.attrib["index"]): lane for lane in edge.findall("lane")}
    lanes = []
    for index in range(int(edge.attrib["numLanes"])):
        lane = given.get(index, Element("lane"))
        if "allow" not in lane.attrib and "disallow" not in lane.attrib:
            lane.attrib.update({key: value for key, value in shared.items() if key != "width"})
        if "width" in shared:
            lane.attrib.setdefault("width", shared["width"])
        lanes.append(lane)
    others = [child for child in edge if child.tag != "lane"]
    for child in list(edge):
        edge.remove(child)
    driven = (lane for lane in lanes if is_driven(lane.attrib))
    for lane, width in zip(driven, changed.driving_m, strict=True):
        lane.set("width", f"{width:.2f}")
    before = next(number for number, lane in enumerate(lanes) if not is_walked(lane.attrib))
    if changed.kerb_m:
        lanes.insert(before, _parking_lane(changed.kerb_m))
    if changed.far_m:
        lanes.append(_parking_lane(changed.far_m))
    for index, lane in enumerate(lanes):
        lane.set("index", str(index))
    edge.set("numLanes", str(len(lanes)))
    edge.extend([*lanes, *others])


def _parking_lane(width_m: float) -> Element:
    return Element("lane", {"allow": NOBODY, "width": f"{width_m:.2f}", "type": PARKING_LANE})


def _shift_connections(path: Path, changed: Mapping[str, EdgeLanes], sidewalks: Mapping[str, int]) -> None:
    """Let connections keep their lanes, whose indices are higher by one where a parking lane lies before them."""
    tree = parse(path)
    root = tree.getroot()
    for connection in root.iter("connection"):
        for end, lane in (("from", "fromLane"), ("to", "toLane")):
            name = connection.get(end, "")
            if name in changed and changed[name].kerb_m and lane in connection.attrib:
                index = int(connection.attrib[lane])
                connection.set(lane, str(index + (index >= sidewalks[name])))
    for crossing in root.iter("crossing"):
        crossing.attrib.pop("outlineShape", None)  # of the narrower street
    _write(tree, path)


def _write(tree: "ElementTree[Element]", path: Path) -> None:
    tree.write(path, encoding="utf-8", xml_declaration=True)
