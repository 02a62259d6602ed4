"""Parking lanes put into a SUMO network, by way of netconvert's plain XML.

netconvert writes a network as plain files of nodes, edges, connections and traffic lights; edges get their lanes there,
connections and links of signals keep their lanes, and netconvert makes the network again. Ids, names, turns, crossings
and signal programs stay; kerbs, junctions and crossings get the shapes of the wider streets.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, ElementTree, parse

from shapely import LineString

from pavetwin.world.network import copy_without_stamp
from pavetwin.world.parking.lanes import EdgeLanes
from pavetwin.world.roadnet import PARKING_LANE, is_driven, is_walked
from pavetwin.world.sumo import NO_VALIDATION, run_tool

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
    """How many lanes of each edge lie between its kerb and its border."""
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
