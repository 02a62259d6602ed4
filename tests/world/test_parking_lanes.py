"""Parking lanes: which kerbs get one, what becomes of the other lanes, and what netconvert makes of it."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from shapely import box

from pavetwin.draw.mission_marks import rectangles
from pavetwin.traffic.record import record
from pavetwin.world.build import BuildOptions, Built, build_world
from pavetwin.world.model import LaneKind, World
from pavetwin.world.network import network_from_osm
from pavetwin.world.parking.lanes import EdgeLanes, insert_lanes
from pavetwin.world.parking.mapped import ParkingMap
from pavetwin.world.parking.place import ParkingSource
from pavetwin.world.parking.places import parking_places
from pavetwin.world.roadnet import RoadNet, read_roadnet
from pavetwin.world.segments import segments_of, streets_of
from pavetwin.world.store import save_world
from scenes import built, scene_file
from scenes.kerbs import Scene, europe
from scenes.traffic import make_network

BOTH = {"parking:both": "lane"}


def width_m(scene: Scene) -> float:
    """Width of the carriageway with its parking lanes."""
    edges = scene.net(scene.lanes()).edges
    return sum(lane.width_m for name in ("east", "west") if name in edges for lane in edges[name].carriageway)


def test_where_the_map_has_a_width_the_driving_lanes_make_room() -> None:
    scene = Scene(lane_m=5.25, tags={**BOTH, "width": "10.5"})
    assert scene.lanes() == {"east": EdgeLanes(2.0, 0.0, (3.25,)), "west": EdgeLanes(2.0, 0.0, (3.25,))}
    assert width_m(scene) == pytest.approx(10.5)


def test_driving_lanes_keep_2_5_m_and_the_street_is_widened_for_the_rest() -> None:
    scene = Scene(lane_m=4.0, tags={**BOTH, "width": "8"})
    assert {lanes.driving_m for lanes in scene.lanes().values()} == {(2.5,)}
    assert width_m(scene) == pytest.approx(9.0)
    already_narrow = Scene(lane_m=2.25, tags={**BOTH, "width": "4.5"})
    assert {lanes.driving_m for lanes in already_narrow.lanes().values()} == {(2.25,)}


def test_a_one_way_street_keeps_a_passage() -> None:
    """3.05 m, not 2.5: what remains is all that there is to pass."""
    scene = Scene(lane_m=6.0, one_way=True, tags={**BOTH, "width": "6"})
    (lanes,) = (lanes for name, lanes in scene.lanes().items() if name == "east")
    assert (lanes.kerb_m, lanes.far_m, lanes.driving_m) == (2.0, 2.0, (3.05,))


def test_without_a_mapped_width_the_street_is_widened() -> None:
    scene = Scene(tags=BOTH)
    assert {lanes.driving_m for lanes in scene.lanes().values()} == {(3.25,)}
    assert width_m(scene) == pytest.approx(10.5)


@pytest.mark.parametrize(
    ("tags", "widths"),
    [
        ({"parking:left": "lane", "parking:right": "no"}, (0.0, 2.0)),
        ({"parking:both": "half_on_kerb"}, (1.0, 1.0)),
        ({"parking:both": "lane", "parking:right:orientation": "perpendicular"}, (5.0, 2.0)),
        ({"parking:both": "lane", "parking:right:orientation": "diagonal"}, (5.51, 2.0)),
    ],
)
def test_a_lane_is_as_wide_as_its_row_lies_on_the_street(tags: dict[str, str], widths: tuple[float, float]) -> None:
    lanes = Scene(tags=tags).lanes()
    assert (lanes["east"].kerb_m, lanes["west"].kerb_m) == widths


@pytest.mark.parametrize("position", ["street_side", "on_kerb", "no"])
def test_places_off_the_carriageway_need_no_lane(position: str) -> None:
    assert Scene(tags={"parking:both": position}).lanes() == {}


def test_the_two_sides_of_a_mapped_width_keep_its_middle() -> None:
    one = Scene(lane_m=4.0, tags={"parking:right": "lane", "parking:left": "no", "width": "8"}).lanes()
    assert {lanes.centred for lanes in one.values()} == {True}
    assert {lanes.driving_m for lanes in one.values()} == {(3.0,)}
    assert {lanes.centred for lanes in Scene(lane_m=4.0, tags={**BOTH, "width": "8"}).lanes().values()} == {False}


def test_no_lane_runs_into_a_house() -> None:
    """The kerb is at 3.25 m and would come to 5.25 m."""
    beside, behind = box(40, -20, 60, -5.2), box(40, -20, 60, -6.5)
    assert Scene(tags=BOTH, buildings=[behind]).lanes()["east"].kerb_m == 2.0
    lanes = Scene(tags=BOTH, buildings=[beside]).lanes()
    assert (lanes["east"].kerb_m, lanes["west"].kerb_m) == (0.0, 2.0)
    assert all(place.centre.y > 0 for place in Scene(tags=BOTH, buildings=[beside]).places())


def test_a_street_without_parking_lanes_has_no_places() -> None:
    scene = Scene(tags=BOTH)
    streets = streets_of(scene.net())
    bare = parking_places(scene.net(), streets, segments_of(streets), (), (), scene.mapped(), europe())
    assert bare == ()
    assert scene.places()


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize("one_way", [False, True])
def test_places_lie_on_parking_lanes(left_hand: bool, one_way: bool) -> None:
    scene = Scene(tags=BOTH, left_hand=left_hand, one_way=one_way)
    lanes = surface(scene.net(scene.lanes()), LaneKind.PARKING).buffer(0.02)
    places = scene.places()
    assert len({place.side for place in places}) == 2
    assert all(lanes.contains(place.polygon) for place in places)


def surface(net: RoadNet | World, kind: LaneKind) -> shapely.Geometry:
    """Area covered by lanes of a kind."""
    lanes = net.lanes if isinstance(net, World) else [lane for edge in net.edges.values() for lane in edge.lanes]
    return shapely.union_all(
        [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in lanes if lane.kind is kind]
    )


@pytest.fixture(scope="module")
def without() -> Built:
    return build_world(scene_file("cross"), BuildOptions(seed=1, parking_rule="none"))


def test_without_a_rule_the_network_is_netconverts(without: Built, tmp_path: Path) -> None:
    network_from_osm(scene_file("cross"), tmp_path / "roads.net.xml")
    assert without.network == (tmp_path / "roads.net.xml").read_bytes()
    assert built("cross").network != without.network


def test_turns_signals_and_names_stay(without: Built, tmp_path: Path) -> None:
    before, after = (_read(made.network, tmp_path) for made in (without, built("cross")))
    assert {edge.id: (edge.name, edge.type, edge.start, edge.end) for edge in before.edges.values()} == {
        edge.id: (edge.name, edge.type, edge.start, edge.end) for edge in after.edges.values()
    }
    assert _turns(before) == _turns(after)
    assert len(_turns(before)) > 20
    assert before.signalled == after.signalled
    assert _count(before, LaneKind.SIDEWALK) == _count(after, LaneKind.SIDEWALK)
    assert _count(before, LaneKind.DRIVING) == _count(after, LaneKind.DRIVING)
    assert [crossing.id for crossing in before.crossings] == [crossing.id for crossing in after.crossings]
    first, second = (
        [(phase.get("state"), phase.get("duration")) for phase in ElementTree.fromstring(made.network).iter("phase")]
        for made in (without, built("cross"))
    )
    assert first == second


def _count(net: RoadNet, kind: LaneKind) -> dict[str, int]:
    return {edge.id: sum(lane.kind is kind for lane in edge.lanes) for edge in net.edges.values()}


def _read(network: bytes, folder: Path) -> RoadNet:
    (folder / "read.net.xml").write_bytes(network)
    return read_roadnet(folder / "read.net.xml")


def _turns(net: RoadNet) -> Counter[tuple[object, ...]]:
    """Connections, their lanes counted among the driving lanes of their edge."""
    number = {}
    for edge in net.edges.values():
        driven = [lane for lane in edge.lanes if lane.kind is LaneKind.DRIVING]
        number.update({lane.id: (edge.id, index) for index, lane in enumerate(driven)})
    return Counter(
        (number[each.from_lane], number[each.to_lane], each.direction, each.signal) for each in net.connections
    )


def test_parking_lanes_belong_to_the_carriageway_and_to_no_traffic(without: Built) -> None:
    world = built("cross").world
    lanes = surface(world, LaneKind.PARKING)
    assert lanes.area > 500
    inspected = shapely.union_all([segment.polygon for segment in world.segments])
    assert lanes.difference(inspected.buffer(0.05)).area < 0.02 * lanes.area
    assert all(lanes.buffer(0.1).contains(place.polygon) for place in world.parking)
    assert lanes.intersection(surface(world, LaneKind.DRIVING)).area < 0.02 * lanes.area
    assert lanes.intersection(surface(world, LaneKind.SIDEWALK)).area < 0.03 * lanes.area
    assert [segment.lanes for segment in world.segments] == [segment.lanes for segment in without.world.segments]


def test_crossings_reach_over_parking_lanes() -> None:
    """From kerb to kerb: pedestrians do not wait among parked vehicles."""
    world = built("town").world
    kerb = world.carriageway.boundary
    parked = {lane.edge for lane in world.lanes_of(LaneKind.PARKING)}
    assert parked
    for crossing in world.crossings:
        ring = shapely.points(crossing.polygon.exterior.coords[:4])
        assert shapely.distance(ring, kerb).max() < 4.5, crossing.id


@pytest.mark.parametrize("left_hand", [False, True])
def test_both_sides_of_the_road_get_their_lanes(left_hand: bool) -> None:
    world = (
        build_world(scene_file("cross"), BuildOptions(seed=1, left_hand=True)).world
        if left_hand
        else built("cross").world
    )
    lanes = surface(world, LaneKind.PARKING).buffer(0.1)
    assert len(world.parking) > 30
    assert all(lanes.contains(place.polygon) for place in world.parking)
    edges = world.lanes_by_edge
    kerb_lanes = [lane for lane in world.lanes_of(LaneKind.PARKING) if lane.index <= 1]
    for lane in kerb_lanes:
        driven = next(other for other in edges[lane.edge] if other.kind is LaneKind.DRIVING)
        towards = world.beside(lane, 1.5)
        assert towards.distance(driven.centre_line) < lane.centre_line.distance(driven.centre_line)


def test_houses_and_trees_of_a_town_stand_clear_of_its_parking_lanes() -> None:
    world = built("town").world
    lanes = surface(world, LaneKind.PARKING)
    things = [building.polygon for building in world.buildings] + [each.position for each in world.furniture]
    assert len(world.parking) > 400
    assert {place.source for place in world.parking} == {ParkingSource.RULE}
    assert shapely.distance(np.array(things, dtype=object), lanes).min() > 0.3
    walks = surface(world, LaneKind.SIDEWALK)
    assert shapely.area(shapely.intersection(np.array(things[: len(world.buildings)], dtype=object), walks)).max() < 0.1


def test_traffic_does_not_drive_through_parked_vehicles(tmp_path: Path) -> None:
    """A street with a row along both kerbs. The same places on the lanes of the street as it was are driven through."""
    plain, wide = make_network("short", tmp_path / "plain.net.xml"), tmp_path / "wide.net.xml"
    lanes = EdgeLanes(2.0, 0.0, (3.2,))
    insert_lanes(plain, {"ab": lanes, "ba": lanes}, wide, left_hand=False)
    world = save_world(build_world(wide, BuildOptions(anchor=(52.0, 13.0))), tmp_path / "wide")
    assert len(world.parking) > 20
    assert met(world, [place.polygon for place in world.parking]) < 0.01
    net = read_roadnet(plain)
    streets = streets_of(net)
    segments = segments_of(streets)
    beside = build_world(plain, BuildOptions(anchor=(52.0, 13.0)))
    assert beside.world.parking == (), "a user's network is taken as it is"
    on_lanes = parking_places(net, streets, segments, beside.world.buildings, (), ParkingMap(), europe(), planned=True)
    narrow = save_world(replace(beside, world=replace(beside.world, parking=on_lanes)), tmp_path / "narrow")
    assert met(narrow, [place.polygon for place in on_lanes]) > 0.3


def met(world: World, places: list[shapely.Polygon]) -> float:
    """Share of the positions of vehicles that overlap a place."""
    recording = record(world, "high", 1, 60.0)
    agents = recording.agents
    rows = np.flatnonzero(~agents.is_pedestrian[recording.agent])
    assert len(rows) > 100
    who = recording.agent[rows]
    bodies = rectangles(
        *(column[rows].astype(np.float64) for column in (recording.x, recording.y, recording.yaw_rad)),
        agents.width_m[who].astype(np.float64),
        agents.length_m[who].astype(np.float64),
    )
    hit, _ = shapely.STRtree(places).query(shapely.polygons(bodies), predicate="intersects")
    return len(np.unique(hit)) / len(rows)
