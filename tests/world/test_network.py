"""Road networks from maps and from SUMO: content, connections, refused sources."""

import gzip
import math
from dataclasses import replace
from pathlib import Path

import osmium
import pyogrio
import pytest
import shapely

from pavetwin.errors import PaveTwinError
from pavetwin.world import sumo
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.georeference import anchored, from_location, from_wgs84, parse_anchor
from pavetwin.world.model import Direction, Lane, LaneKind, SignalLink, World
from pavetwin.world.network import source_kind, with_sidewalks
from pavetwin.world.segments import pair_edges
from pavetwin.world.store import load_world, save_world
from scenes import HERE, built, net_of, scene_file
from scenes.roads import net_text, parting_lanes
from scenes.traffic import scene_world


def test_only_connected_streets_for_cars_are_kept(tmp_path: Path) -> None:
    net = net_of("cross", tmp_path)
    names = {edge.name for edge in net.edges.values() if edge.for_cars}
    assert names == {"Hauptstraße", "Nebenstraße", "Bogen", "Anger", ""}
    assert not any(edge.id.lstrip("-").startswith(("110", "111", "112")) for edge in net.edges.values())


def test_the_signalled_cross_has_signals_on_its_four_approaches_and_crossings(tmp_path: Path) -> None:
    net = net_of("cross", tmp_path)
    assert len(net.signalled) == 4
    assert len(set(net.signalled.values())) == 1
    assert sum(crossing.signalled for crossing in net.crossings) == 4
    assert any(not crossing.signalled for crossing in net.crossings)


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"highway": "residential"}, "both"),
        ({"highway": "residential", "sidewalk": "separate"}, "both"),
        ({"highway": "residential", "sidewalk": "no"}, "none"),
        ({"highway": "residential", "sidewalk:both": "separate"}, "both"),
        ({"highway": "residential", "sidewalk:left": "no", "sidewalk:right": "separate"}, "right"),
        ({"highway": "primary_link"}, "both"),
        ({"highway": "motorway"}, "none"),
        ({"highway": "living_street", "sidewalk": "left"}, "left"),
        ({"highway": "residential", "junction": "roundabout"}, "none"),
    ],
)
def test_sidewalks_are_on_both_sides_unless_the_map_denies_it(tags: dict[str, str], expected: str) -> None:
    changed = with_sidewalks(tags)
    assert changed["sidewalk"] == expected
    assert [key for key in changed if key.startswith("sidewalk")] == ["sidewalk"]


def test_a_one_way_street_is_one_edge_with_sidewalks_on_both_sides(tmp_path: Path) -> None:
    net = net_of("cross", tmp_path)
    street = next(pair for pair in pair_edges(net.edges.values()) if pair[0].name == "Bogen")
    assert len(street) == 1
    line = street[0].carriageway[0].centre_line
    sides = set()
    for edge in net.edges.values():
        for lane in edge.lanes:
            if edge.name == "Bogen" and lane.kind is LaneKind.SIDEWALK:
                middle = lane.centre_line.interpolate(0.5, normalized=True)
                sides.add(line.offset_curve(2.0).distance(middle) < line.offset_curve(-2.0).distance(middle))
    assert sides == {True, False}


def test_packed_and_binary_maps_give_the_same_segments(tmp_path: Path) -> None:
    plain = scene_file("cross")
    packed = tmp_path / "cross.osm.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    binary = tmp_path / "cross.osm.pbf"
    with osmium.SimpleWriter(str(binary)) as writer:
        for item in osmium.FileProcessor(str(plain)):
            writer.add(item)
    expected = [shapely.to_wkt(segment.polygon, 2) for segment in built("cross").world.segments]
    for source in (packed, binary):
        world = build_world(source, BuildOptions(seed=1)).world
        assert [shapely.to_wkt(segment.polygon, 2) for segment in world.segments] == expected


def test_the_georeference_brings_a_map_back_to_its_place() -> None:
    world = built("cross").world
    assert world.georeference.epsg == 32633
    crossing = from_wgs84(world.georeference, (13.0, 52.0))
    junction = min(world.junctions, key=lambda junction: junction.polygon.distance(shapely.Point(crossing)))
    assert junction.polygon.contains(shapely.Point(crossing))
    assert world.georeference.to_wgs84(crossing) == pytest.approx((13.0, 52.0), abs=1e-9)


def test_a_network_without_a_place_is_anchored() -> None:
    assert from_location({"projParameter": "!"}, "x") is None
    place = anchored(48.14, 11.58)
    assert place.epsg == 32632
    assert place.to_wgs84((0.0, 0.0)) == pytest.approx((11.58, 48.14), abs=1e-6)
    south = from_location({"projParameter": "+proj=utm +zone=56 +south +datum=WGS84", "netOffset": "-5,-7"}, "x")
    assert south is not None
    assert (south.epsg, south.offset_east_m, south.offset_north_m) == (32756, 5.0, 7.0)


def test_an_odd_projection_asks_for_an_anchor() -> None:
    with pytest.raises(PaveTwinError, match="`anchor`"):
        from_location({"projParameter": "+proj=tmerc +lat_0=1 +lon_0=9 +k=1 +x_0=0"}, "x.net.xml")


@pytest.mark.parametrize("text", ["", "52", "52;13", "a,b", "52,13,4", "91,0", "0,200", "nan,0"])
def test_a_bad_anchor_is_refused(text: str) -> None:
    with pytest.raises(PaveTwinError, match="anchor"):
        parse_anchor(text)


def test_a_users_network_is_taken_as_it_is(tmp_path: Path) -> None:
    made = built("cross")
    own = tmp_path / "own.net.xml"
    own.write_bytes(made.network)
    again = build_world(own, BuildOptions(seed=1))
    assert again.network == made.network
    assert again.world.segments == made.world.segments
    assert again.world.georeference == made.world.georeference
    assert again.record.mapped.get("buildings", 0) == 0
    assert len(again.world.buildings) > 20, "houses are placed by rule where the source has none"


def bad_sources(folder: Path) -> dict[str, tuple[Path, str]]:
    """Files that are not a source, each with a word of the message."""
    whole = (HERE / "cross.osm").read_text(encoding="utf-8")
    texts = {
        "truncated.osm": (whole[: len(whole) // 2], "cut short"),
        "plain.osm": ("hello", "cut short"),
        "empty.osm": ("", "cut short"),
        "streetless.osm": ("<osm version='0.6'><node id='1' version='1' lat='1' lon='1'/></osm>", "no streets"),
        "roads.txt": ("hello", "suffix"),
        "plain.net.xml": ("hello", "not readable as XML"),
        "other.net.xml": ("<routes/>", "not a SUMO network"),
        "half.net.xml": ("<net><edge id='a'></net>", "not readable as XML"),
        "edgeless.net.xml": ("<net><location netOffset='0,0' projParameter='!'/></net>", "no streets"),
        "odd.net.xml": ("<net><edge id='a' from='b'/></net>", "not a complete SUMO network"),
    }
    sources = {"missing.osm": (folder / "missing.osm", "does not exist")}
    for name, (text, word) in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
        sources[name] = (folder / name, word)
    for name, suffix in (("packed.osm", ".osm.pbf"), ("zipped.osm", ".osm.gz")):
        with osmium.SimpleWriter(str(folder / f"made{suffix}")) as writer:
            writer.add_node(osmium.osm.mutable.Node(id=1, location=(13.4, 52.5)))
        (folder / f"made{suffix}").rename(folder / name)
        sources[name] = (folder / name, f"is {suffix} by its content; rename it so that it ends in {suffix}")
    packed = folder / "truncated.osm.gz"
    packed.write_bytes(gzip.compress(whole.encode())[:900])
    sources[packed.name] = (packed, "cut short")
    network = folder / "truncated.net.xml.gz"
    network.write_bytes(gzip.compress(whole.encode())[:900])
    sources[network.name] = (network, "cut short")
    return sources


def test_bad_sources_are_one_plain_line(tmp_path: Path) -> None:
    for name, (source, word) in bad_sources(tmp_path).items():
        with pytest.raises(PaveTwinError, match=word) as caught:
            build_world(source)
        assert "\n" not in str(caught.value), name
        assert source.name in str(caught.value), name


def test_a_map_needs_no_anchor() -> None:
    with pytest.raises(PaveTwinError, match="`anchor`"):
        build_world(scene_file("cross"), BuildOptions(anchor=(1.0, 2.0)))


def test_a_folder_is_no_source(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="is a folder"):
        source_kind(tmp_path)


def test_without_sumo_the_message_explains_the_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sumo, "_candidates", list)
    with pytest.raises(PaveTwinError, match="pip install eclipse-sumo"):
        build_world(scene_file("cross"))


def test_the_first_error_of_a_tool_is_reported() -> None:
    assert sumo.first_error("Warning: x\nError: No nodes loaded.\nQuitting (on error).", "") == "No nodes loaded."
    assert sumo.first_error("", "") == "it ended without a message"


def test_lanes_are_numbered_as_in_the_network_regardless_of_ids(tmp_path: Path) -> None:
    world = parting_lanes(tmp_path).world
    assert [(lane.id, lane.index) for lane in world.lanes_on("in")] == [("at-the-kerb", 0), ("towards-the-middle", 1)]
    assert [lane.index for lane in world.lanes if lane.edge == "in"] == [0, 1]
    assert world.lanes_on("rails") == ()


@pytest.mark.parametrize("left_hand", [False, True])
def test_the_middle_of_a_street_is_on_the_side_that_the_network_drives_on(tmp_path: Path, left_hand: bool) -> None:
    world = parting_lanes(tmp_path, left_hand=left_hand).world
    assert world.left_hand is left_hand
    kerb, middle = world.lanes_on("in")
    between = world.beside(kerb, kerb.width_m / 2)
    assert between.distance(middle.centre_line) == pytest.approx(middle.width_m / 2)
    assert world.beside(kerb, -kerb.width_m / 2).distance(middle.centre_line) == pytest.approx(1.5 * middle.width_m)
    street = next(street for street in world.streets if street.name == "Way")
    assert street.centre_line.distance(between) < 0.01


def test_a_street_keeps_its_class_and_junctions(tmp_path: Path) -> None:
    street = next(street for street in parting_lanes(tmp_path).world.streets if street.name == "Way")
    assert (street.id, street.kind, street.edges, street.start, street.end) == (
        "in",
        "highway.primary",
        ("in",),
        "a",
        "m",
    )
    both = next(street for street in built("cross").world.streets if len(street.edges) == 2)
    assert [both.end_of(edge) for edge in both.edges] == [both.end, both.start]


def test_connections_run_along_internal_lanes_and_know_turn_and_signal(tmp_path: Path) -> None:
    ahead, aside = parting_lanes(tmp_path).world.connections
    assert (ahead.from_lane, ahead.to_lane, ahead.direction) == ("at-the-kerb", "x", Direction.STRAIGHT)
    assert (aside.from_lane, aside.to_lane, aside.direction) == ("towards-the-middle", "y", Direction.LEFT)
    assert (ahead.signal, aside.signal) == (SignalLink("lights", 4), SignalLink("lights", 7))
    corners = [(100, 0), (104, 0), (106, 12)]
    assert list(aside.centre_line.coords) == corners, "over both internal lanes"


def _heading(lane: Lane, end: int) -> float:
    (ax, ay), (bx, by) = list(lane.centre_line.coords)[-2:] if end else list(lane.centre_line.coords)[:2]
    return math.atan2(by - ay, bx - ax)


def _turned(world: World, from_lane: str, to_lane: str) -> float:
    lanes = {lane.id: lane for lane in world.lanes}
    angle = _heading(lanes[to_lane], 0) - _heading(lanes[from_lane], -1)
    return math.degrees(math.remainder(angle, math.tau))


def test_a_signalled_cross_has_three_turns_an_arm_each_with_its_own_link(tmp_path: Path) -> None:
    world = scene_world("cross", tmp_path)
    angles = {Direction.LEFT: 90.0, Direction.RIGHT: -90.0, Direction.STRAIGHT: 0.0}
    vehicles = [each for each in world.connections if each.signal and each.direction in angles]
    arms: dict[str, set[Direction]] = {}
    for connection in vehicles:
        arms.setdefault(connection.from_lane, set()).add(connection.direction)
        turned = _turned(world, connection.from_lane, connection.to_lane)
        assert turned == pytest.approx(angles[connection.direction], abs=1.0)
    assert [len(turns) for turns in arms.values()] == [3, 3, 3, 3]
    links = [each.signal.link for each in world.connections if each.signal]
    links += [crossing.signal.link for crossing in world.crossings if crossing.signal]
    assert len(world.crossings) == 4
    assert sorted(links) == list(range(len(links))), "every letter of the state belongs to one way across"


@pytest.mark.parametrize("left_hand", [False, True])
def test_all_of_it_comes_back_from_the_geopackage(tmp_path: Path, left_hand: bool) -> None:
    saved = save_world(parting_lanes(tmp_path, left_hand=left_hand), tmp_path / "world")
    loaded = load_world(tmp_path / "world")
    assert loaded == saved
    assert loaded.left_hand is left_hand
    assert len(loaded.connections) == 2
    assert loaded.lanes_on("in")[1].id == "towards-the-middle"
    layers = dict(pyogrio.list_layers(tmp_path / "world" / "world.gpkg"))
    assert layers["streets"] == layers["connections"] == "LineString"


def test_layers_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    made = parting_lanes(tmp_path)
    world = made.world
    one, other = world.lanes_on("in")
    rest = tuple(lane for lane in world.lanes if lane.edge != "in")
    lost = replace(world.connections[0], to_lane="nowhere")
    cases = {
        "lost": (replace(world, connections=(lost,)), "from 'at-the-kerb' to 'nowhere' names the lane 'nowhere'"),
        "twice": (replace(world, lanes=(one, replace(other, index=0), *rest)), "of the edge 'in' have one index, 0"),
        "same": (replace(world, lanes=(*world.lanes, one)), "two lanes have the id 'at-the-kerb'"),
        "homeless": (replace(world, streets=()), "'s0001' lies on the edges"),
    }
    for name, (conflicting, words) in cases.items():
        save_world(replace(made, world=conflicting), tmp_path / name)
        with pytest.raises(PaveTwinError, match=r"contradicts itself.*build it again") as caught:
            load_world(tmp_path / name)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('to="ahead" fromLane="0" toLane="0" via', 'to="ahead" fromLane="0" toLane="3" via', "to lane 3 of the edge"),
        ('<connection from="in"', '<connection from="of"', "from lane 0 of the edge 'of'"),
        ('via="inside c"', 'via="inside d"', "runs over 'inside d'"),
        (
            'id="at-the-kerb" index="0"',
            'id="at-the-kerb" index="1"',
            "of the edge 'in' have one index, 1",
        ),
    ],
)
def test_a_network_that_contradicts_itself_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = net_text()
    assert old in text
    path = tmp_path / "broken.net.xml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(PaveTwinError, match=r"broken\.net\.xml' is not a complete SUMO network") as caught:
        build_world(path)
    assert words in str(caught.value)
