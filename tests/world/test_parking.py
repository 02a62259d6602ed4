"""Parking places: what tags, areas and the rule give to a street, and where they lie."""

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import LineString, box

from pavetwin.world.parking.mapped import ObstacleKind
from pavetwin.world.parking.place import (
    ParkingOrientation,
    ParkingPlace,
    ParkingPosition,
    ParkingSource,
    StreetSide,
)
from pavetwin.world.parking.places import on_carriageway
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.kerbs import Scene, europe

LANE = {"parking:both": "lane", "parking:both:orientation": "parallel", "width": "10.5"}
KERB = 5.25
WIDE = Scene(lane_m=KERB, tags=LANE)
"""10.5 m from kerb to kerb, with parking on both sides."""


def span(place: ParkingPlace, axis: int = 0) -> tuple[float, float]:
    bounds = place.polygon.bounds
    return bounds[axis], bounds[axis + 2]


def on(places: tuple[ParkingPlace, ...], side: StreetSide) -> list[ParkingPlace]:
    return sorted((place for place in places if place.side is side), key=lambda place: place.centre.x)


def test_a_street_with_parking_has_a_place_every_5_2_m_on_both_sides() -> None:
    places = WIDE.places()
    assert Counter(place.side for place in places) == {StreetSide.LEFT: 19, StreetSide.RIGHT: 19}
    assert {place.source for place in places} == {ParkingSource.TAGGED}
    for side in StreetSide:
        row = on(places, side)
        assert [later.centre.x - place.centre.x for place, later in pairwise(row)] == pytest.approx([5.2] * 18)


def test_places_on_the_street_end_at_the_mapped_kerb() -> None:
    for place in WIDE.places():
        near, far = sorted(map(abs, span(place, 1)))
        assert (near, far) == (pytest.approx(KERB - 2.0), pytest.approx(KERB))


def test_parked_vehicles_face_along_the_adjacent_traffic() -> None:
    places = WIDE.places()
    assert {round(place.yaw_rad, 6) for place in on(places, StreetSide.RIGHT)} == {0.0}
    assert {round(abs(place.yaw_rad), 6) for place in on(places, StreetSide.LEFT)} == {round(math.pi, 6)}


def test_a_mapped_width_beyond_the_lanes_puts_places_next_to_them() -> None:
    """Two lanes of 3.25 m on a street of 12.5 m: 3 m of asphalt on each side are not a lane."""
    for place in Scene(tags={**LANE, "width": "12.5"}).places():
        assert min(map(abs, span(place, 1))) == pytest.approx(3.25, abs=0.01)


def test_without_a_mapped_width_rows_lie_next_to_the_driving_lanes() -> None:
    places = Scene(tags={"parking:both": "lane"}).places()
    inner = {side: min(min(map(abs, span(place, 1))) for place in on(places, side)) for side in StreetSide}
    assert sum(inner.values()) == pytest.approx(6.5, abs=0.01)


def test_vehicles_park_next_to_lanes_if_nothing_else_is_there() -> None:
    for place in Scene(tags={"parking:both": "lane"}, sidewalks=False).places():
        assert min(map(abs, span(place, 1))) == pytest.approx(3.25, abs=0.01)


@pytest.mark.parametrize(
    ("position", "inner_m"), [("half_on_kerb", KERB - 1.0), ("on_kerb", KERB), ("street_side", KERB)]
)
def test_positions_next_to_and_on_the_kerb(position: str, inner_m: float) -> None:
    places = Scene(lane_m=KERB, tags={**LANE, "parking:both": position}).places()
    assert places
    for place in places:
        assert place.position is ParkingPosition(position)
        assert min(map(abs, span(place, 1))) == pytest.approx(inner_m, abs=0.01)


@pytest.mark.parametrize(
    "tags",
    [
        {"parking:both": "no"},
        {"parking:both": "lane", "parking:both:restriction": "no_stopping"},
        {"parking:lane:both": "no_stopping"},
        {"parking:both": "separate"},
    ],
)
def test_a_street_without_parking_has_no_place(tags: dict[str, str]) -> None:
    assert Scene(lane_m=KERB, tags=tags).places() == ()


def test_a_side_of_its_own_is_that_side_of_the_way() -> None:
    places = Scene(lane_m=KERB, tags={"width": "10.5", "parking:left": "lane", "parking:right": "no"}).places()
    assert places
    assert {place.side for place in places} == {StreetSide.LEFT}
    assert all(place.centre.y > 0 for place in places)


def test_a_loading_bay_keeps_its_hours() -> None:
    tags = {**LANE, "parking:both:restriction:conditional": "loading_only @ (Mo-Fr 07:00-17:00)"}
    assert {place.closed for place in Scene(lane_m=KERB, tags=tags).places()} == {"Mo-Fr 07:00-17:00"}


def test_a_mapped_capacity_is_taken() -> None:
    tags = {**LANE, "parking:both:capacity": "16"}
    places = Scene(lane_m=KERB, tags=tags).places()
    assert Counter(place.side for place in places) == {StreetSide.LEFT: 16, StreetSide.RIGHT: 16}


def test_an_area_along_the_street_is_filled() -> None:
    area = box(20, -10.5, 50, -5.4)
    tags = {"parking": "street_side", "orientation": "perpendicular"}
    places = Scene(lane_m=KERB, tags={"parking:both": "separate"}, areas=[(area, tags)]).places()
    assert len(places) == 12
    assert {place.source for place in places} == {ParkingSource.AREA}
    assert {place.orientation for place in places} == {ParkingOrientation.PERPENDICULAR}
    assert all(area.buffer(0.3).contains(place.polygon) for place in places)


def test_of_places_that_overlap_those_in_areas_stay() -> None:
    area = box(20, -10.5, 50, -5.4)
    bay = {"parking": "street_side", "orientation": "perpendicular"}
    tags = {"parking:right": "street_side", "parking:left": "no"}
    places = Scene(lane_m=KERB, tags=tags, areas=[(area, bay)]).places()
    sources = Counter(place.source for place in places)
    assert sources[ParkingSource.AREA] == 12
    assert sources[ParkingSource.TAGGED] == 12
    cores = [place.polygon.buffer(-0.03) for place in places]
    assert shapely.STRtree(cores).query(cores, predicate="intersects").shape[1] == len(places)


def test_a_car_park_is_no_parking_along_the_street() -> None:
    tags = {"parking": "surface"}
    scene = Scene(lane_m=KERB, tags={"parking:both": "no"}, areas=[(box(20, -10, 50, -5.4), tags)])
    assert scene.places() == ()


@pytest.mark.parametrize(
    ("kind", "at", "clear"),
    [
        (ObstacleKind.BUS_STOP, (50.0, -7.0), (35.0, 65.0)),
        (ObstacleKind.CROSSING, (50.0, 0.0), (48.0, 52.0)),
        (ObstacleKind.MARKED_CROSSING, (50.0, 0.0), (43.0, 52.0)),
    ],
)
def test_obstacles_stay_clear(kind: ObstacleKind, at: tuple[float, float], clear: tuple[float, float]) -> None:
    row = on(replace(WIDE, obstacles=[(kind, at)]).places(), StreetSide.RIGHT)
    gap = [place for place in row if span(place)[1] > clear[0] + 0.01 and span(place)[0] < clear[1] - 0.01]
    assert gap == []
    assert 19 - len(row) <= (clear[1] - clear[0]) / 5.2 + 2


def test_a_bus_stop_belongs_to_its_side() -> None:
    places = replace(WIDE, obstacles=[(ObstacleKind.BUS_STOP, (50.0, -7.0))]).places()
    assert len(on(places, StreetSide.LEFT)) == 19


def test_the_mouth_of_a_driveway_stays_clear() -> None:
    places = replace(WIDE, mouths=[LineString([(50, 0), (50, 30)])]).places()
    assert len(on(places, StreetSide.RIGHT)) == 19
    assert not any(span(place)[0] < 52 and span(place)[1] > 48 for place in on(places, StreetSide.LEFT))


def test_a_mast_stays_free() -> None:
    scene = Scene(lane_m=KERB, tags={**LANE, "parking:both": "street_side"}, masts=[(50.0, -6.0)])
    mast = shapely.Point(50.0, -6.0).buffer(0.12)
    assert len(on(scene.places(), StreetSide.RIGHT)) >= 17
    assert not any(place.polygon.intersects(mast) for place in scene.places())


def test_a_place_keeps_away_from_houses() -> None:
    house = box(40, -20, 60, -6.0)
    scene = Scene(lane_m=KERB, tags={**LANE, "parking:both": "street_side"}, buildings=[house])
    row = on(scene.places(), StreetSide.RIGHT)
    assert 12 <= len(row) < 19
    assert all(place.polygon.distance(house) >= 1.0 for place in row)


def test_5_m_before_and_behind_a_junction_stay_clear() -> None:
    """The side street's edges are at x = 60 ± 5.25: no places on its side of the street from 49.75 to 70.25."""
    places = replace(WIDE, length_m=140.0, side_street_at=60.0).places()
    along = [place for place in places if place.polygon.bounds[3] > -KERB - 1]
    right = on(tuple(along), StreetSide.RIGHT)
    assert right
    assert not any(span(place)[1] > 49.76 and span(place)[0] < 70.24 for place in right if place.centre.y < 0)


def test_the_rule_gives_places_to_streets_with_houses_or_of_some_classes() -> None:
    rows = [box(x, -30, x + 8, -12) for x in range(0, 100, 10)]
    net = Scene(lane_m=KERB, kind="")
    assert net.places() == ()
    assert {place.source for place in replace(net, buildings=rows).places()} == {ParkingSource.RULE}
    assert Scene(lane_m=KERB, kind="highway.residential").places()
    assert Scene(lane_m=KERB, kind="highway.primary", buildings=rows).places() == ()


@pytest.mark.parametrize(("lane_m", "sides"), [(2.4, 0), (3.0, 1), (3.75, 2)])
def test_the_rule_leaves_a_passage(lane_m: float, sides: int) -> None:
    assert len({place.side for place in Scene(lane_m=lane_m).places()}) == sides


def test_no_place_on_a_bridge_by_rule() -> None:
    assert Scene(lane_m=KERB, tags={}).places()
    assert Scene(lane_m=KERB, tags={"bridge": "yes"}).places() == ()


SCENES = st.builds(
    Scene,
    length_m=st.floats(20, 220),
    lane_m=st.floats(2.75, 6.5),
    one_way=st.booleans(),
    left_hand=st.booleans(),
    sidewalks=st.booleans(),
    tags=st.builds(
        lambda position, left, right: {
            "parking:both": position,
            "parking:left:orientation": left,
            "parking:right:orientation": right,
        },
        st.sampled_from(["lane", "half_on_kerb", "on_kerb", "street_side"]),
        st.sampled_from(["parallel", "diagonal", "perpendicular"]),
        st.sampled_from(["parallel", "diagonal", "perpendicular"]),
    ),
    side_street_at=st.none() | st.floats(8, 12),
)


@given(SCENES)
def test_places_never_overlap_and_stay_on_their_side(scene: Scene) -> None:
    places = scene.places()
    cores = [place.polygon.buffer(-0.03, join_style="mitre") for place in places]
    first, second = shapely.STRtree(cores).query(cores, predicate="intersects")
    assert (first == second).all()
    junctions = shapely.union_all([junction.polygon for junction in scene.net().junctions])
    for place, core in zip(places, cores, strict=True):
        assert not core.intersects(junctions)
        if not place.id.startswith(("south", "north")):
            left = place.side is StreetSide.LEFT
            assert (place.centre.y > 0) == left


@pytest.mark.slow
@given(SCENES)
def test_the_other_driving_side_mirrors_every_place(scene: Scene) -> None:
    """A street seen in a mirror: y changes its sign, and so do angles; left and right of the map change places."""
    tags = scene.tags or {}
    swapped = {
        key.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right"): value
        for key, value in tags.items()
    }
    scene = replace(scene, side_street_at=None)
    mirrored = replace(scene, left_hand=not scene.left_hand, tags=swapped)

    def poses(scene: Scene, sign: int) -> list[tuple[float, ...]]:
        return sorted(
            (round(place.centre.x, 3), round(sign * place.centre.y, 3), round(math.cos(place.yaw_rad), 3),
             round(sign * math.sin(place.yaw_rad), 3))
            for place in scene.places()
        )  # fmt: skip

    ours, theirs = poses(scene, 1), poses(mirrored, -1)
    assert len(ours) == len(theirs)
    assert np.allclose(ours, theirs, atol=2e-3)


def test_diagonal_places_point_ahead_and_outwards() -> None:
    places = Scene(lane_m=6.0, tags={"parking:both": "lane", "parking:both:orientation": "diagonal"}).places()
    angle = math.radians(europe().places[ParkingOrientation.DIAGONAL].angle_deg)
    for place in places:
        right = place.side is StreetSide.RIGHT
        expected = -angle if right else math.remainder(math.pi - angle, math.tau)
        assert place.yaw_rad == pytest.approx(expected)


def test_ids_do_not_depend_on_what_is_further_on() -> None:
    whole = {place.id for place in WIDE.places()}
    shorter = {place.id for place in replace(WIDE, obstacles=[(ObstacleKind.BUS_STOP, (80.0, -7.0))]).places()}
    assert len({name for name in shorter if name.startswith("west")} & whole) == 19


@pytest.mark.parametrize("name", ["cross", "berlin_neukoelln", "town"])
def test_no_place_of_a_world_is_on_a_junction_a_crossing_or_in_a_house(name: str) -> None:
    world = built(name).world
    places = [place.polygon.buffer(-0.06, join_style="mitre") for place in world.parking]
    others = [each.polygon for each in (*world.junctions, *world.crossings, *world.buildings)]
    assert places
    assert shapely.STRtree(others).query(places, predicate="intersects").size == 0
    assert shapely.STRtree(places).query(places, predicate="intersects").shape[1] == len(places)
    assert {place.segment for place in world.parking} <= {segment.id for segment in world.segments}
    assert {place.street for place in world.parking} <= {street.id for street in world.streets}


def test_a_generated_town_keeps_clear_before_its_zebra_crossings() -> None:
    world, before_m = built("town").world, europe().clear.marked_crossing_m
    zebras = [crossing.polygon for crossing in world.crossings if not crossing.signalled]
    reach_m = 5.2 / 2 + before_m - 0.1
    ahead = [
        LineString([at, (at.x + reach_m * math.cos(yaw), at.y + reach_m * math.sin(yaw))])
        for at, yaw in ((place.centre, place.yaw_rad) for place in world.parking)
    ]
    assert shapely.STRtree(zebras).query(ahead, predicate="intersects").size == 0


def test_parking_is_a_layer_of_the_geopackage(tmp_path: Path) -> None:
    made = built("cross")
    world = save_world(made, tmp_path / "world")
    info = pyogrio.read_info(tmp_path / "world" / "world.gpkg", layer="parking")
    assert info["features"] == len(world.parking) > 0
    assert info["geometry_type"] == "Polygon"
    assert {"id", "street", "segment", "side", "position", "orientation", "source", "closed", "yaw_rad"} <= set(
        info["fields"]
    )
    assert load_world(tmp_path / "world").parking == world.parking


def test_the_summary_knows_what_is_on_the_carriageway() -> None:
    world = built("cross").world
    shares = on_carriageway(world)
    assert shares.shape == (len(world.parking),)
    for share, place in zip(shares, world.parking, strict=True):
        surface = shapely.union_all([segment.polygon for segment in world.segments])
        assert share == pytest.approx(surface.intersection(place.polygon).area / place.polygon.area, abs=1e-6)
