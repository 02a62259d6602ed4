"""Parking bays and gutters along kerbs: level, paved, clear of objects and of defects in asphalt."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.defects import DefectOptions, place
from pavetwin.scene.furniture import StreetObjects
from pavetwin.scene.ground import GroundPlan, ground_pieces, plan_ground
from pavetwin.scene.ground.layout.kerbside import TAPER_M
from pavetwin.scene.ground.layout.relief import KERB_M, Relief, heights
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.markings.placement import parking_lines
from pavetwin.scene.ground.mesh.ground_mesh import BAY_RIM_M, faces_of
from pavetwin.scene.patches import holes_of
from pavetwin.scene.values import TILE_M, GroundKind
from pavetwin.world.model import LaneKind
from pavetwin.world.parking import ParkingPlace, ParkingPosition
from pavetwin.world.pavement_joints import GUTTER_M, has_gutter
from scenes import built
from scenes.parking import kerb_place, with_places
from scenes.tiny import straight

BAY_Y_M = 4.7
"""Of a place 2 m wide, 0.2 m next to a street 7 m wide."""


def beside(position: ParkingPosition = ParkingPosition.STREET_SIDE) -> ParkingPlace:
    return replace(kerb_place(30.0, BAY_Y_M), position=position)


@cache
def plan(position: ParkingPosition | None) -> GroundPlan:
    return plan_ground(with_places(straight(), *([] if position is None else [beside(position)])), 0)


def kind_at(where: GroundPlan, x: float, y: float) -> GroundKind:
    key = int(x // TILE_M), int(y // TILE_M)
    (face,) = (f for f in faces_of(where, key, Relief(where, tile_box(key))) if f.polygon.contains(Point(x, y)))
    return face.kind


def test_a_bay_is_paved_like_the_street_behind_a_flush_rim_where_there_was_lawn() -> None:
    with_bay, without = plan(ParkingPosition.STREET_SIDE), plan(None)
    assert kind_at(without, 30.0, BAY_Y_M) is GroundKind.GRASS
    assert kind_at(with_bay, 30.0, BAY_Y_M) is kind_at(with_bay, 30.0, 1.0) is GroundKind.ASPHALT
    assert kind_at(with_bay, 30.0, 3.5 + BAY_RIM_M / 2) is GroundKind.CONCRETE
    assert kind_at(with_bay, 40.0, BAY_Y_M) is GroundKind.GRASS


def test_a_bay_is_level_with_the_carriageway_and_has_a_kerb_around_it() -> None:
    across = np.array(
        [(x, y) for x, y in zip((29.0, 29.5, 30.0, 30.5, 31.0), (3.0, 3.6, BAY_Y_M, 5.8, 6.3), strict=True)]
    )
    np.testing.assert_allclose(heights(plan(ParkingPosition.STREET_SIDE), across), [0, 0, 0, 0, KERB_M], atol=1e-6)


def test_nothing_changes_where_all_places_lie_on_the_carriageway() -> None:
    world = built("cross").world
    assert world.parking
    assert plan_ground(world, 0).road is world.carriageway
    assert not len(plan_ground(world, 0).bays)


@pytest.mark.parametrize("position", [ParkingPosition.ON_KERB, ParkingPosition.HALF_ON_KERB])
def test_a_place_on_the_kerb_is_paved_at_the_height_of_the_sidewalk(position: ParkingPosition) -> None:
    assert kind_at(plan(position), 30.0, BAY_Y_M) is GroundKind.PAVING
    assert not len(plan(position).bays)


def test_places_in_bays_are_divided_by_lines() -> None:
    lines = [line for line, _ in parking_lines(plan(ParkingPosition.STREET_SIDE).world)]
    assert sorted(round(line.centroid.x, 1) for line in lines) == [27.4, 32.6]
    assert all(shapely.union_all(plan(ParkingPosition.STREET_SIDE).bays.shapes).contains(line) for line in lines)


def test_no_bench_stands_in_a_bay() -> None:
    world = built("cross").world
    first = StreetObjects(world, seed=0).extras()[0]
    assert list(world.lanes_of(LaneKind.SIDEWALK))
    place = replace(beside(), centre=Point(first.x_m, first.y_m), segment=world.segments[0].id)
    again = StreetObjects(with_places(world, place), seed=0).extras()
    assert not any(place.polygon.contains(Point(extra.x_m, extra.y_m)) for extra in again)
    assert len(again) > 1


NAMES = ("berlin_neukoelln", "seattle_roosevelt")


@cache
def town_plan(name: str) -> GroundPlan:
    return plan_ground(built(name).world, 3)


@pytest.mark.parametrize("name", NAMES)
def test_some_streets_have_gutters_along_their_kerbs_and_others_none(name: str) -> None:
    where = town_plan(name)
    gutters, road = shapely.union_all(where.gutters.shapes), where.world.carriageway
    assert gutters.area > 50
    assert gutters.difference(road.buffer(0.01)).area < 1e-6
    assert gutters.difference(road.boundary.buffer(GUTTER_M + 0.03)).area < 0.01 * gutters.area
    for segment in where.world.segments:
        if not has_gutter(segment.street):
            assert gutters.intersection(segment.polygon).area < 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_gutters_narrow_to_nothing_where_they_end(name: str) -> None:
    """From a hand's breadth before its end to its end a gutter is narrower than a third of its width."""
    where = town_plan(name)
    gutters = shapely.union_all(where.gutters.shapes)
    free = shapely.line_merge(shapely.difference(where.world.carriageway.boundary, gutters.buffer(0.01)))
    widths, before = [], []
    for line in shapely.get_parts(free):
        if line.length < 2 * TAPER_M + 1:
            continue
        for end, out in ((0.0, -1.0), (line.length, 1.0)):
            spot = line.interpolate(end)
            inner = line.interpolate(end - out * 0.5)
            step = np.array([spot.x - inner.x, spot.y - inner.y]) / spot.distance(inner)
            for back, found in ((0.15, widths), (TAPER_M + 0.3, before)):
                at = np.array([spot.x, spot.y]) + back * step
                across = shapely.LineString([at + 0.6 * step[::-1] * (-1, 1), at - 0.6 * step[::-1] * (-1, 1)])
                found.append(shapely.intersection(across, gutters).length)
    assert len(widths) > 4
    assert np.median(widths) < GUTTER_M / 3
    assert np.median(before) > 0.8 * GUTTER_M


@pytest.mark.slow
def test_no_defect_reaches_into_a_gutter() -> None:
    """Not even the ring about it that is drawn again; on streets without gutters some come nearer to the edge."""
    where = town_plan("berlin_neukoelln")
    with_gutter = [segment for segment in where.world.segments if has_gutter(segment.street)][:4]
    without = [segment for segment in where.world.segments if not has_gutter(segment.street)][:4]
    options = DefectOptions(population="paper", per_segment=40)
    gutters = shapely.union_all(where.gutters.shapes)
    placed = place(with_gutter, 5, options)
    assert len(placed) > 60
    assert shapely.intersection(shapely.union_all(holes_of(placed)), gutters).area == 0
    edges = where.world.carriageway.boundary
    assert min(defect.polygon.distance(edges) for defect in placed) > GUTTER_M
    assert min(defect.polygon.distance(edges) for defect in place(without, 5, options)) < GUTTER_M


def test_gutters_are_of_concrete_and_the_road_next_to_them_of_asphalt() -> None:
    where = town_plan("berlin_neukoelln")
    gutter = max(where.gutters.shapes, key=lambda shape: float(shape.area))
    spot = gutter.representative_point()
    key = int(spot.x // TILE_M), int(spot.y // TILE_M)
    area = {}
    for piece in ground_pieces(where, key):
        corners = piece.mesh.positions[piece.mesh.indices].astype(float)[..., :2] + np.array(key) * TILE_M
        middles = shapely.points(corners.mean(axis=1))
        sizes = np.array([shapely.Polygon(triangle).area for triangle in corners])
        area[piece.kind] = float(sizes[shapely.intersects(gutter.buffer(-1e-4), middles)].sum())
    box = shapely.box(key[0] * TILE_M, key[1] * TILE_M, (key[0] + 1) * TILE_M, (key[1] + 1) * TILE_M)
    expected = shapely.intersection(gutter, box).area
    assert area[GroundKind.CONCRETE] == pytest.approx(expected, rel=0.02)
    assert area.get(GroundKind.ASPHALT, 0.0) < 0.02 * expected
