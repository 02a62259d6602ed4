"""What stands beside the streets: buildings, furniture, and the solids made of them."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from pavetwin.world.buildings import clear_of_roads
from pavetwin.world.furniture import TREE_OVERHANG_M
from pavetwin.world.ground import Nearby, PlacementGround
from pavetwin.world.model import Building, Furniture, FurnitureKind, LaneKind, World
from pavetwin.world.osm_file import building_height_m, metres
from pavetwin.world.segments import union_of
from pavetwin.world.solids import SolidKind, Solids, convex_parts, furniture_prisms, solids
from scenes import built, net_of

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


def test_map_and_rule_are_told_apart() -> None:
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


def test_nearby_finds_what_meets_the_bounds() -> None:
    near: Nearby[str] = Nearby(10.0)
    near.add((0, 0, 25, 5), "long")
    near.add((100, 100, 100, 100), "point")
    assert set(near.query((20, 4, 22, 30))) == {"long"}
    assert set(near.query((95, 95, 105, 105))) == {"point"}
    assert set(near.query((40, 40, 50, 50))) == set()


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


def test_a_yard_is_left_open() -> None:
    ring = Polygon([(0, 0), (20, 0), (20, 20), (0, 20)], [[(5, 5), (5, 15), (15, 15), (15, 5)]])
    parts = [Polygon(part) for part in convex_parts(Building("b", ring, 9.0))]
    assert sum(part.area for part in parts) == pytest.approx(300)
    assert not any(part.contains(Point(10, 10)) for part in parts)


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
