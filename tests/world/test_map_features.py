"""Map features: buildings, furniture, their solids, bridges, and pavements that are not asphalt."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon

from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import BuildOptions, Built, build_world
from pavetwin.world.buildings import clear_of_roads
from pavetwin.world.content import content_hash
from pavetwin.world.furniture import TREE_OVERHANG_M
from pavetwin.world.ground import PlacementGround
from pavetwin.world.model import Furniture, FurnitureKind, LaneKind, World
from pavetwin.world.osm import bridges_on, paving_m2, paving_words
from pavetwin.world.osm_file import building_height_m, metres
from pavetwin.world.segments import union_of
from pavetwin.world.solids import SolidKind, Solids, furniture_prisms, solids
from pavetwin.world.store import load_world, save_world
from scenes import HERE, built, damaged, net_of
from scenes.command_line import pavetwin

TOWNS = ("cross", "berlin_neukoelln", "seattle_roosevelt", "grid")


def roads(world: World) -> shapely.Geometry:
    surfaces = [segment.polygon for segment in world.segments] + [junction.polygon for junction in world.junctions]
    return union_of(surfaces, 1e-6)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("12", 12.0),
        ("10 m", 10.0),
        ("10,5", 10.5),
        ("40 ft", 12.192),
        ("12'", 3.658),
        ("12'6\"", 3.81),
        ("3;4", 4.0),
        ("~8", 8.0),
        ("250 cm", 2.5),
        ("", None),
        (None, None),
        ("tall", None),
        ("-3", None),
        ("5 storeys", None),
        (";", None),
    ],
)
def test_lengths_are_read_from_free_text(text: str | None, expected: float | None) -> None:
    found = metres(text)
    assert found == (expected if expected is None else pytest.approx(expected, abs=1e-3))


@given(st.text(max_size=12))
def test_no_tag_breaks_the_reading_of_heights(text: str) -> None:
    height = building_height_m({"building": "yes", "height": text, "building:levels": text, "roof:levels": text}, 100)
    assert 2.0 <= height <= 400.0


def test_buildings_of_the_cross_have_their_heights_and_the_yard_its_hole() -> None:
    buildings = built("cross").world.buildings
    block = max(buildings, key=lambda building: building.polygon.area)
    assert len(block.polygon.interiors) == 1
    assert block.height_m == pytest.approx(4 * 3.0 + 1.5), "3;4 levels and a roof"
    heights = sorted(building.height_m for building in buildings)
    assert heights == pytest.approx([3.0, 9.5, 9.5, 12.19, 13.5])


def test_a_gatehouse_over_the_street_is_cut_back_to_the_kerb() -> None:
    world = built("cross").world
    gatehouse = next(building for building in world.buildings if building.polygon.area > 500 and building.height_m < 10)
    assert gatehouse.polygon.area < 0.95 * 41.2 * 22.3
    assert gatehouse.polygon.distance(roads(world)) >= 0.15


@pytest.mark.parametrize("name", TOWNS)
def test_nothing_stands_on_a_road_or_in_a_building(name: str) -> None:
    world = built(name).world
    surface = roads(world)
    shapely.prepare(surface)
    assert not [building.id for building in world.buildings if surface.intersects(building.polygon)]
    assert not [thing.id for thing in world.furniture if surface.distance(thing.position) < 0.35]
    houses = shapely.STRtree([building.polygon for building in world.buildings])
    assert houses.query([thing.position for thing in world.furniture], "intersects").size == 0
    assert not [park for park in world.parks if park.intersection(surface).area > 1e-6]


@pytest.mark.parametrize("name", TOWNS)
def test_crowns_reach_over_the_road_by_a_metre_at_most(name: str) -> None:
    world = built(name).world
    surface = roads(world)
    for tree in world.furniture:
        if tree.kind is FurnitureKind.TREE:
            assert surface.distance(tree.position) >= tree.radius_m - TREE_OVERHANG_M - 0.01
            assert 0 < tree.clear_height_m < tree.height_m


@pytest.mark.parametrize("name", TOWNS)
def test_every_signalled_approach_has_one_mast_whose_arm_reaches_over_its_lanes(name: str, tmp_path: Path) -> None:
    world = built(name).world
    signals = [thing for thing in world.furniture if thing.kind is FurnitureKind.SIGNAL]
    assert all(signal.height_m >= 5.5 and signal.controller for signal in signals)
    surface = roads(world)
    for signal in signals:
        tip = Point(
            signal.position.x + signal.arm_m * math.cos(signal.yaw_rad),
            signal.position.y + signal.arm_m * math.sin(signal.yaw_rad),
        )
        assert surface.contains(tip)
    if name != "grid":
        assert len(signals) >= 0.8 * len(net_of(name, tmp_path).signalled)


def test_street_lights_stand_every_thirty_metres_and_look_at_the_road() -> None:
    world = built("grid").world
    lights = [thing for thing in world.furniture if thing.kind is FurnitureKind.STREET_LIGHT]
    length = sum(segment.length_m for segment in world.segments)
    assert 0.7 <= len(lights) / (length / 30.0) <= 1.2
    surface = roads(world)
    for light in lights:
        tip = Point(
            light.position.x + light.arm_m * math.cos(light.yaw_rad),
            light.position.y + light.arm_m * math.sin(light.yaw_rad),
        )
        assert surface.distance(tip) < surface.distance(light.position)


def test_map_and_rule_are_counted_separately() -> None:
    record = built("cross").record
    assert record.mapped["buildings"] == 5
    assert record.mapped["tree"] == 2
    assert record.mapped["pole"] == 1
    assert record.mapped["sign"] == 1
    assert built("grid").record.mapped["buildings"] == 0


def test_houses_by_rule_keep_off_the_sidewalks_and_each_other() -> None:
    world = built("grid").world
    walks = [lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in world.lanes_of(LaneKind.SIDEWALK)]
    tree = shapely.STRtree(walks)
    assert all(6.0 <= building.height_m <= 19.0 for building in world.buildings)
    for building in world.buildings:
        nearest = walks[int(tree.nearest(building.polygon))]
        assert nearest.distance(building.polygon) >= 2.5
    houses = shapely.STRtree([building.polygon for building in world.buildings])
    pairs = houses.query([building.polygon for building in world.buildings], "intersects")
    assert pairs.shape[1] == len(world.buildings), "each meets only itself"


def test_changing_the_seed_changes_the_rule_but_not_the_map() -> None:
    one, two = built("cross").world, built("cross", seed=2).world
    assert one.segments == two.segments
    assert one.buildings == two.buildings
    assert one.furniture != two.furniture
    assert one.content_hash != two.content_hash


def test_a_thing_on_the_road_is_moved_behind_the_nearest_kerb(tmp_path: Path) -> None:
    ground = PlacementGround(net_of("cross", tmp_path))
    segment = next(each for each in built("cross").world.segments if each.street == "Bogen")
    middle = segment.centre_line.interpolate(0.5, normalized=True)
    moved = ground.beside_road(middle, 0.6, 4.0)
    assert moved is not None
    assert ground.road_distance_m(moved) == pytest.approx(0.6, abs=0.02)
    assert ground.beside_road(middle, 0.6, 1.0) is None


def test_a_building_mostly_on_the_road_is_dropped(tmp_path: Path) -> None:
    ground = PlacementGround(net_of("cross", tmp_path))
    segment = built("cross").world.segments[5]
    assert clear_of_roads([(segment.centre_line.buffer(4.0), 5.0)], ground) == ()


def is_convex(ring: np.ndarray) -> bool:
    edges = np.roll(ring, -1, axis=0) - ring
    turns = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
    return bool((turns >= -1e-9).all())


@pytest.mark.parametrize("name", TOWNS)
def test_solids_are_convex_prisms_of_the_same_volume(name: str) -> None:
    world = built(name).world
    prisms = solids(world)
    areas = [Polygon(prisms.base(index)).area for index in range(len(prisms))]
    assert all(is_convex(prisms.base(index)) for index in range(len(prisms)))
    houses = prisms.kind == SolidKind.BUILDING
    volume = float(np.sum(np.array(areas)[houses] * (prisms.z1 - prisms.z0)[houses]))
    expected = sum(building.polygon.area * building.height_m for building in world.buildings)
    assert volume == pytest.approx(expected, rel=1e-6)
    assert np.count_nonzero(prisms.kind == SolidKind.CROWN) == np.count_nonzero(prisms.kind == SolidKind.TRUNK)
    arms = prisms.kind == SolidKind.ARM
    assert np.allclose((prisms.z1 - prisms.z0)[arms], 0.3)


def test_a_signal_arm_lies_at_its_height() -> None:
    signal = Furniture("s", FurnitureKind.SIGNAL, Point(3, 4), 6.0, 0.1, yaw_rad=math.pi / 2, arm_m=5.0)
    kinds = dict(furniture_prisms(signal))
    ring, low, high = kinds[SolidKind.ARM]
    assert (low, high) == pytest.approx((5.85, 6.15))
    assert Polygon(ring).bounds == pytest.approx((2.9, 4.0, 3.1, 9.0))


def test_an_empty_world_has_no_solids_and_arrays_must_belong_together() -> None:
    none = Solids(np.zeros(1, np.int64), np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0, np.uint8))
    assert len(none) == 0
    with pytest.raises(ValueError, match="belong together"):
        Solids(np.zeros(3, np.int64), np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0, np.uint8))


STREET = LineString([(0, 0), (60, 0), (100, 40)])
EXTRACT = """<?xml version='1.0' encoding='UTF-8'?>
<osm version="0.6" generator="by hand">
<node id="1" version="1" lat="50.0" lon="8.0000"/><node id="2" version="1" lat="50.0" lon="8.0010"/>
<node id="3" version="1" lat="50.0" lon="8.0015"/><node id="4" version="1" lat="50.0" lon="8.0030"/>
<way id="10" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/><tag k="name" v="High"/></way>
<way id="11" version="1"><nd ref="2"/><nd ref="3"/><tag k="highway" v="residential"/><tag k="name" v="High"/>
<tag k="bridge" v="yes"/><tag k="layer" v="1"/></way>
<way id="12" version="1"><nd ref="3"/><nd ref="4"/><tag k="highway" v="residential"/><tag k="name" v="High"/></way>
</osm>
"""


@cache
def bridge_town() -> Built:
    with TemporaryDirectory() as folder:
        source = Path(folder) / "bridge.osm"
        source.write_text(EXTRACT, encoding="utf-8")
        return build_world(source, BuildOptions(seed=1))


def test_a_bridge_covers_the_stations_along_its_way() -> None:
    assert bridges_on(STREET, [LineString([(40, 2), (20, 2)])]) == ((20.0, 40.0),)
    assert bridges_on(STREET, [LineString([(40, 30), (20, 30)])]) == ()
    across = LineString([(30, -20), (30, 20)])
    assert bridges_on(STREET, [across]) == ()


def test_a_way_that_goes_on_beyond_the_street_counts_as_far_as_it_follows_it() -> None:
    assert bridges_on(STREET, [LineString([(-40, 0), (25, 0)])]) == ((0.0, 25.0),)


def test_a_bridge_of_an_extract_is_kept_with_the_world(tmp_path: Path) -> None:
    streets = [street for street in bridge_town().world.streets if street.bridges]
    assert streets
    total_m = sum(last - first for street in streets for first, last in street.bridges)
    assert 30.0 < total_m < 42.0
    assert load_world(save_world(bridge_town(), tmp_path / "town").folder or "").streets == bridge_town().world.streets


def test_bridges_are_not_part_of_the_content() -> None:
    world = bridge_town().world
    other = replace(world, streets=tuple(replace(street, bridges=()) for street in world.streets))
    assert other != world
    assert content_hash(other, "") == content_hash(world, "")


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the crossing, one of whose streets is of setts."""
    text = (HERE / "cross.osm").read_text(encoding="utf-8")
    first = text.index('<tag k="name" v="Nebenstraße"/>')
    path = tmp_path_factory.mktemp("paving") / "cross.osm"
    path.write_text(text[:first] + '<tag k="surface" v="sett"/>' + text[first:], encoding="utf-8")
    return path


def test_the_area_of_setts_is_that_of_the_street_s_segments(mapped: Path) -> None:
    made = build_world(mapped, BuildOptions(seed=1))
    area_m2 = made.record.paving_m2["sett"]
    assert list(made.record.paving_m2) == ["sett"]
    assert 50 < area_m2 < 0.9 * sum(segment.area_m2 for segment in made.world.segments)
    # The pavement is reported, and is no part of the world.
    assert made.world.content_hash == built("cross").world.content_hash


def test_asphalt_is_not_mentioned() -> None:
    segments = built("cross").world.segments
    ways = {int(edge.lstrip("-").split("#")[0]) for segment in segments for edge in segment.edges}
    assert paving_m2(segments, dict.fromkeys(ways, "asphalt")) == {}
    assert paving_words({}) == ""
    (area_m2,) = paving_m2(segments, dict.fromkeys(ways, "cobblestone")).values()
    assert area_m2 == pytest.approx(sum(segment.area_m2 for segment in segments), abs=0.1)


def test_uninspected_area_and_placed_defects_are_reported(mapped: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cross"
    world = save_world(add_defects(build_world(mapped), DefectOptions(population="paper", per_segment=2)), folder)
    assert 0 < world.outside_segments_m2 < world.carriageway.area / 2
    message = " ".join(pavetwin("world", "info", folder).stdout.split())
    outside = f"{world.outside_segments_m2:.0f} m² of junctions and crossings"
    assert outside in message
    assert "placed by the program, not surveyed" in message
    assert "damage classes are those of asphalt" in message
    flown = pavetwin("fly", folder, "--density", "low", "--segments", "1", "-o", tmp_path / "m").stdout
    assert f"Defects are placed by the program, not surveyed; not inspected: {outside}" in flown


def test_streets_are_listed_with_their_segments(tmp_path: Path) -> None:
    folder = tmp_path / "cross"
    world = save_world(damaged("cross", 0), folder)
    lines = pavetwin("world", "info", folder, "--streets").stdout.splitlines()
    names = {segment.street_name for segment in world.segments}
    assert len(lines) == 1 + len(names)
    for name in names:
        own = [segment for segment in world.segments if segment.street_name == name]
        (line,) = [line for line in lines if line.startswith(name)]
        assert all(segment.id in line for segment in own)
        assert line.split()[-1] == f"{sum(segment.area_m2 for segment in own):.0f}"
