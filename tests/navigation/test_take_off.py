"""The base: next to the carriageway, clear of standing objects, or where a user puts it."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import prepare
from pavetwin.navigation.navmesh import navmesh, part_at
from pavetwin.navigation.take_off import CLEARANCE_M, parse_base, roadside
from pavetwin.world.model import Furniture, FurnitureKind, LaneKind, World
from pavetwin.world.solids import solids
from scenes import built
from scenes.tiny import block, street, world

RADIUS_M = 0.5
KEEP_M = RADIUS_M + CLEARANCE_M


def carriageway(of: World) -> shapely.Geometry:
    return shapely.union_all([each.polygon for each in (*of.segments, *of.junctions)])


def assert_free(of: World, place: Point) -> None:
    """Off the road, clear of all that stands, and in the part of every mesh that the streets are in."""
    standing = solids(of)
    assert carriageway(of).distance(place) >= KEEP_M - 1e-6
    bases = [shapely.Polygon(standing.base(index)) for index in range(len(standing))]
    assert min((base.distance(place) for base in bases), default=np.inf) >= KEEP_M - 0.02
    for altitude_m in (6.0, 10.0, 15.0):
        mesh = navmesh(of, altitude_m, RADIUS_M)
        assert mesh.contains(place.x, place.y), altitude_m
        assert part_at(mesh, place) == part_at(mesh, of.base)


@pytest.mark.parametrize("scene", ["cross", "town"])
def test_the_base_is_next_to_the_carriageway_and_in_reach(scene: str) -> None:
    of = built(scene).world
    place = roadside(of, RADIUS_M, solids(of))
    assert_free(of, place)
    assert place.distance(of.base) < 40
    walks = [lane.centre_line.buffer(lane.width_m / 2) for lane in of.lanes_of(LaneKind.SIDEWALK)]
    assert min((walk.distance(place) for walk in walks), default=np.inf) > 0


@given(st.lists(st.tuples(st.floats(-30, 30), st.sampled_from([-1, 1])), max_size=8))
def test_the_base_is_clear_of_objects_next_to_the_road(trees: list[tuple[float, int]]) -> None:
    along = street("main", (-60, 0), (60, 0))
    edge_m = along.polygon.bounds[3]
    things = [
        Furniture(f"t{number}", FurnitureKind.POLE, Point(x, side * (edge_m + 2)), 9.0, 0.3)
        for number, (x, side) in enumerate(trees)
    ]
    of = replace(world([along], base=(0, 0)), furniture=tuple(things))
    assert_free(of, roadside(of, RADIUS_M, solids(of)))


def test_between_houses_that_reach_the_kerb_the_street_itself_is_left() -> None:
    along = street("main", (-700, 0), (700, 0))
    low, high = along.polygon.bounds[1], along.polygon.bounds[3]
    walls = (block("wall", -700, high + 1, 700, high + 9, 30), block("wall", -700, low - 9, 700, low - 1, 30))
    of = world([along], buildings=walls, base=(0, 0))
    assert roadside(of, RADIUS_M, solids(of)) == of.base


def test_the_presets_decide_on_the_base() -> None:
    of = built("cross").world
    assert prepare(of, load_settings("paper")).world.base == of.base
    moved = prepare(of, load_settings("default")).world.base
    assert moved == roadside(of, RADIUS_M, solids(of))
    assert moved != of.base
    given_here = prepare(of, load_settings("default"), base=of.base)
    assert given_here.world.base == of.base


def test_a_base_is_given_in_degrees_or_in_metres() -> None:
    of = built("cross").world
    lon, lat = of.georeference.to_wgs84((of.base.x, of.base.y))
    assert parse_base(f"{lat:.8f},{lon:.8f}", of).distance(of.base) < 0.02
    assert parse_base("120.5, 80", of) == Point(120.5, 80)
    assert parse_base("10,20", of) == Point(10, 20)  # degrees, but a continent away
    with pytest.raises(PaveTwinError, match="expected LAT,LON in degrees"):
        parse_base("here", of)
    with pytest.raises(
        PaveTwinError, match=r"`base` -85,170: in degrees it is [\d,]{5,} km .* in metres of its frame \d+ m"
    ):
        parse_base("-85,170", of)


def test_a_base_in_a_house_or_far_from_all_streets_is_refused() -> None:
    along = street("main", (-60, 0), (60, 0))
    high = along.polygon.bounds[3]
    of = world([along], buildings=(block("house", 0, high + 1, 10, high + 9, 4.0),), base=(0, 0))
    for place, words in (
        (Point(5, high + 2), r"a standing object leaves no room \(building\)"),
        (Point(0, 300), "the nearest street is .* m away"),
    ):
        with pytest.raises(PaveTwinError, match=words):
            prepare(of, load_settings("default"), base=place)
