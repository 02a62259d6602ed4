"""Parked vehicles: kinds, times and positions."""

import datetime as dt
import hashlib
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.traffic.demand import DEFAULT_MIX
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.parked import ParkedVehicles, occupancy, occupancy_curves, parked_vehicles, surroundings_of
from pavetwin.world.model import Lane, LaneKind, World
from pavetwin.world.parking.place import ParkingOrientation, ParkingPlace, ParkingPosition, ParkingSource, StreetSide
from scenes import tiny

NOON = Conditions(date=dt.date(2026, 11, 20), time=dt.time(12))
"""A Friday."""


def row(count: int = 200, length_m: float = 5.2, width_m: float = 2.0, **other: Any) -> World:
    """The usual street with so many places in a row."""
    places = tuple(
        ParkingPlace(
            **{
                "id": f"east:r{number}",
                "street": "street",
                "segment": "street",
                "side": StreetSide.RIGHT,
                "position": ParkingPosition.LANE,
                "orientation": ParkingOrientation.PARALLEL,
                "centre": Point(number * length_m, -3.0),
                "yaw_rad": 0.0,
                "length_m": length_m,
                "width_m": width_m,
                "source": ParkingSource.RULE,
                **other,
            }
        )
        for number in range(count)
    )
    return replace(tiny.straight(), parking=places)


def bodies(parked: ParkedVehicles) -> list[Polygon]:
    poses = zip(parked.x, parked.y, parked.yaw_rad, parked.length_m, parked.width_m, strict=True)
    found = []
    for x, y, yaw, length, width in poses:
        body = shapely.affinity.rotate(
            shapely.box(-length / 2, -width / 2, length / 2, width / 2), yaw, origin=(0, 0), use_radians=True
        )
        found.append(shapely.affinity.translate(body, x, y))
    return found


def parked(world: World, share: float | None, seed: int = 1, conditions: Conditions = NOON) -> ParkedVehicles:
    return parked_vehicles(world, ParkingSettings(enabled=True, occupancy=share), conditions, seed)


def test_everything_parked_and_nothing() -> None:
    assert list(parked(row(), 1.0).place) == list(range(200))
    assert len(parked(row(), 0.0)) == len(ParkedVehicles.empty()) == 0
    assert len(parked_vehicles(row(), ParkingSettings(enabled=False, occupancy=1.0), NOON, 1)) == 0


def test_about_as_many_as_asked_are_taken() -> None:
    assert len(parked(row(2000), 0.6)) == pytest.approx(1200, abs=70)


@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 2**31))
def test_what_is_taken_stays_taken_by_the_same_vehicle_when_more_park(one: float, other: float, seed: int) -> None:
    few, many = (parked(row(40), share, seed) for share in sorted((one, other)))
    by_place = {place: index for index, place in enumerate(many.place)}
    assert set(few.place) <= set(by_place)
    for index, place in enumerate(few.place):
        also = by_place[place]
        assert few.kind[index] == many.kind[also]
        assert (few.x[index], few.y[index], few.yaw_rad[index]) == (many.x[also], many.y[also], many.yaw_rad[also])


def test_a_place_does_not_depend_on_others() -> None:
    world = row(40)
    half = replace(world, parking=world.parking[::2])
    all_of, some = parked(world, 0.5), parked(half, 0.5)
    assert [2 * place for place in some.place] == [place for place in all_of.place if place % 2 == 0]


def test_the_seed_decides() -> None:
    assert list(parked(row(), 0.5, 1).place) != list(parked(row(), 0.5, 2).place)
    assert list(parked(row(), 0.5, 1).place) == list(parked(row(), 0.5, 1).place)


@pytest.mark.parametrize(
    ("length_m", "width_m", "orientation"),
    [(5.2, 2.0, "parallel"), (5.0, 2.5, "diagonal"), (5.0, 2.5, "perpendicular"), (6.9, 2.4, "parallel")],
)
def test_vehicles_stay_within_their_places_a_little_askew(length_m: float, width_m: float, orientation: str) -> None:
    world = row(300, length_m, width_m, orientation=ParkingOrientation(orientation), yaw_rad=0.4)
    found = parked(world, 1.0)
    for place, body in zip(found.place, bodies(found), strict=True):
        assert world.parking[place].polygon.buffer(1e-6).contains(body)
    turned = np.array([math.remainder(yaw - 0.4, math.pi) for yaw in found.yaw_rad])
    assert 0.2 < np.degrees(turned).std() < 2.0
    assert len(np.unique(found.x)) == len(found)


def test_kinds_are_those_of_traffic_that_fit() -> None:
    found = parked(row(2000), 1.0)
    assert set(found.kind) == {"hatchback", "compact", "saloon", "suv", "van", "motorcycle"}
    for name, length in zip(found.kind, found.length_m, strict=True):
        assert length == KINDS[name].length_m <= 5.2
    assert "light_truck" in parked(row(2000, 7.0, 2.4), 1.0).kind
    assert found.kind.count("compact") > found.kind.count("motorcycle") * 3


def test_parked_vehicles_follow_the_mix_of_traffic() -> None:
    def kinds(mix: str, length_m: float = 6.1) -> dict[str, float]:
        full = ParkingSettings(occupancy=1.0)
        found = parked_vehicles(row(2000, length_m, 2.1), full, NOON, 1, mix).kind
        return {kind: found.count(kind) / len(found) for kind in set(found)}

    assert kinds("europe") == kinds(DEFAULT_MIX)
    assert not {"scooter", "pickup", "auto_rickshaw"} & set(kinds("europe"))
    assert kinds("east_asia")["scooter"] == pytest.approx(0.48 / 0.93, abs=0.04), "of those that park and fit"
    assert kinds("north_america")["pickup"] > 0.1
    assert "pickup" not in kinds("north_america", length_m=5.2)
    assert {"scooter", "auto_rickshaw"} <= set(kinds("south_asia"))


def test_draws_of_parked_vehicles_are_stable() -> None:
    """Kinds and positions to the last bit."""
    found, draws = parked(row(400), 0.7, seed=5), hashlib.sha256()
    draws.update(" ".join(found.kind).encode())
    for column in (found.place, found.x, found.y, found.yaw_rad, found.height_m, found.appearance):
        draws.update(np.ascontiguousarray(column).tobytes())
    assert draws.hexdigest()[:16] == "9e8e3041b498d1ed"


def test_some_are_reversed_into_perpendicular_places_only() -> None:
    def backwards(orientation: ParkingOrientation) -> int:
        yaws = parked(row(500, 5.0, 2.5, orientation=orientation), 1.0).yaw_rad
        return int((np.abs(yaws) > math.pi / 2).sum())

    assert backwards(ParkingOrientation.PARALLEL) == 0
    assert 60 < backwards(ParkingOrientation.PERPENDICULAR) < 140


def test_a_loading_bay_is_empty_at_its_hours() -> None:
    bay = row(closed="Mo-Fr 07:00-17:00")
    assert len(parked(bay, 1.0)) == 0
    assert len(parked(bay, 1.0, conditions=NOON.model_copy(update={"time": dt.time(18)}))) == 200


def test_residents_are_at_home_at_night_and_shops_are_visited_by_day() -> None:
    def share(kind: str, hour: int) -> float:
        return occupancy(surroundings_of(kind), NOON.model_copy(update={"time": dt.time(hour)}))

    assert share("highway.residential", 3) > share("highway.residential", 12)
    assert share("highway.secondary", 3) < share("highway.secondary", 12)
    assert share("", 3) == share("highway.residential", 3)


@pytest.mark.parametrize(("kmh", "around"), [(20, "residential"), (30, "residential"), (50, "mixed"), (60, "mixed")])
def test_surroundings_without_a_class_follow_from_the_speed_limit(kmh: float, around: str) -> None:
    assert surroundings_of("", round(kmh / 3.6, 2)) == surroundings_of("main", kmh / 3.6) == around
    assert surroundings_of("highway.residential", kmh / 3.6) == "residential"


def test_fast_streets_of_a_generated_town_have_the_curve_of_mixed_surroundings() -> None:
    world = row(3000)
    (street,) = world.streets
    lane = Lane("a_0", "a", 0, LaneKind.DRIVING, street.centre_line, 3.0, 13.89)
    fast = replace(world, streets=(replace(street, edges=("a",)),), lanes=(lane,))
    night = NOON.model_copy(update={"time": dt.time(3)})
    curves = occupancy_curves().curves
    for place, around in ((world, "residential"), (fast, "mixed")):
        taken = len(parked_vehicles(place, ParkingSettings(), night, seed=1)) / 3000
        assert taken == pytest.approx(curves[around]["weekday"][3], abs=0.02)


def test_curves_are_lines_between_hours_and_close_at_midnight() -> None:
    curve = occupancy_curves().curves["mixed"]["weekday"]
    late = NOON.model_copy(update={"time": dt.time(23, 30)})
    assert occupancy("mixed", late) == pytest.approx((curve[23] + curve[0]) / 2)
    saturday = NOON.model_copy(update={"date": dt.date(2026, 11, 21)})
    assert occupancy("mixed", saturday) == occupancy_curves().curves["mixed"]["weekend"][12]


def test_without_a_share_the_curve_of_the_street_counts() -> None:
    world = row(3000)
    night = NOON.model_copy(update={"time": dt.time(3)})
    for conditions in (NOON, night):
        expected = occupancy("residential", conditions) * 3000
        assert len(parked(world, None, conditions=conditions)) == pytest.approx(expected, abs=90)
