"""Bays beside the carriageway: level with it, paved, with a kerb behind them, and nothing else stands in them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Point

from pavetwin.scene.furniture import StreetObjects
from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.layout.relief import KERB_M, Relief, heights
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.markings.placement import parking_lines
from pavetwin.scene.ground.mesh.ground_mesh import BAY_RIM_M, faces_of
from pavetwin.scene.values import TILE_M, GroundKind
from pavetwin.world.model import LaneKind
from pavetwin.world.parking import ParkingPlace, ParkingPosition
from scenes import built
from scenes.parking import kerb_place, with_places
from scenes.tiny import straight

BAY_Y_M = 4.7
"""Of a place 2 m wide, 0.2 m beside a street 7 m wide."""


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
