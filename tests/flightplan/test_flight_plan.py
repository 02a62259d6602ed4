"""Plans in a folder."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import PLAN_FORMATS, FlightPlan, PlannedFlight, Waypoint, save_plan
from pavetwin.flightplan.flight_plan import parts_of
from pavetwin.flightplan.formats.plan_files import remark_on_parts
from pavetwin.world.georeference import anchored


def numbered_plan(flights: int) -> FlightPlan:
    ends = [Waypoint(13.4 + 0.001 * i, 52.5, 10.0, 5.0, i == 0, 0.0, None) for i in range(2)]
    return FlightPlan("m", "mavic3e", (PlannedFlight(tuple(ends)),) * flights, interval_s=0.7, spacing_m=3.5)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_files_of_an_earlier_export_are_removed_and_no_others(tmp_path: Path) -> None:
    save_plan(numbered_plan(3), tmp_path, [PLAN_FORMATS.get("qgc")(), PLAN_FORMATS.get("wpml")()])
    others = ["flight-1-part-2.txt", "flight-2-notes.csv", "flight-log.csv", "zones.geojson"]
    for name in ("flight-1-part-2-litchi.csv", *others):
        (tmp_path / name).write_text("")
    save_plan(numbered_plan(2), tmp_path, [PLAN_FORMATS.get("qgc")()])
    assert names(tmp_path) == sorted(["flight-1.plan", "flight-2.plan", *others])


def test_parts_have_a_remark(tmp_path: Path) -> None:
    points = [Waypoint(13.4 + 0.001 * i, 52.5, 10.0, 5.0, False, 0.0, None) for i in range(150)]
    long = FlightPlan("m", None, (PlannedFlight(tuple(points)),), interval_s=0.7, spacing_m=3.5)
    reported = remark_on_parts(save_plan(long, tmp_path, [PLAN_FORMATS.get("litchi")()])) or ""
    assert reported.startswith("2 files are parts of a flight. Each takes off and lands at the base")
    assert remark_on_parts(save_plan(long, tmp_path, [PLAN_FORMATS.get("qgc")()])) is None


def test_an_export_that_is_refused_removes_nothing(tmp_path: Path) -> None:
    save_plan(numbered_plan(3), tmp_path, [PLAN_FORMATS.get("qgc")()])
    with pytest.raises(PaveTwinError, match="`drone`"):
        save_plan(numbered_plan(2), tmp_path, [PLAN_FORMATS.get("wpml")("mavic3")])
    assert names(tmp_path) == ["flight-1.plan", "flight-2.plan", "flight-3.plan"]


PLACE = anchored(52.47, 13.44)
BASE = (0.0, 0.0)


def waypoint(x_m: float, y_m: float, *, photographs: bool = False) -> Waypoint:
    longitude, latitude = PLACE.to_wgs84((x_m, y_m)).tolist()
    return Waypoint(
        longitude, latitude, 10.0, 5.0 if photographs else 9.0, photographs, 0.5, "s" if photographs else None
    )


@st.composite
def flights(draw: st.DrawFn) -> PlannedFlight:
    """From the base and back, of legs of 3 m and more."""
    steps = draw(st.lists(st.tuples(st.integers(3, 60), st.integers(-40, 40), st.booleans()), min_size=2, max_size=40))
    x, y, points = 0.0, 0.0, [waypoint(*BASE)]
    for east, north, photographs in steps:
        x, y = x + east, y + north
        points.append(waypoint(x, y, photographs=photographs))
    return PlannedFlight((*points, waypoint(*BASE)))


def plan(flight: PlannedFlight) -> FlightPlan:
    return FlightPlan("m", None, (flight,), interval_s=0.7, spacing_m=3.5)


def legs(flight: PlannedFlight) -> list[tuple[float, ...]]:
    pairs = pairwise(flight.waypoints)
    return [(a.longitude, a.latitude, b.longitude, b.latitude, a.photographs, a.speed_mps) for a, b in pairs]


@given(flights(), st.integers(4, 20))
def test_parts_fly_every_leg_once_and_begin_and_end_at_the_base(flight: PlannedFlight, most: int) -> None:
    parts = parts_of(plan(flight), flight, most)
    places = [(part.lonlat[0].tolist(), part.lonlat[-1].tolist()) for part in parts]
    base = flight.lonlat[0].tolist()
    assert all(place == (base, base) for place in places)
    assert all(len(part.waypoints) <= most for part in parts)
    assert all(part.distance_m <= flight.distance_m + 0.01 for part in parts), "by the triangle's inequality"
    flown = [leg for part in parts for leg in legs(part) if leg[4]]
    assert flown == [leg for leg in legs(flight) if leg[4]], "each photographed leg, in order, and no other"
    assert {leg for part in parts for leg in legs(part)} >= set(legs(flight)[1:-1])


def test_a_flight_that_fits_is_one_part() -> None:
    flight = PlannedFlight((waypoint(0, 0), waypoint(50, 0, photographs=True), waypoint(90, 0), waypoint(0, 0)))
    assert parts_of(plan(flight), flight, 4) == [flight]
    assert parts_of(plan(flight), flight, None) == [flight]


def test_ways_go_round_what_stands_there() -> None:
    """The plan's own ways have a corner at (0, 30)."""
    row = [waypoint(10.0 * number, 50.0, photographs=True) for number in range(1, 9)]
    flight = PlannedFlight((waypoint(0, 0), *row, waypoint(0, 0)))
    corner = tuple(PLACE.to_wgs84((0.0, 30.0)).tolist())
    made = replace(plan(flight), way_home=lambda _here, _home: [corner])
    first, *_, last = parts_of(made, flight, 7)
    assert tuple(first.lonlat[-2].tolist()) == corner
    assert tuple(last.lonlat[1].tolist()) == corner
    assert not any(each.photographs for each in (first.waypoints[-2], last.waypoints[0], last.waypoints[1]))


def test_ways_that_fill_a_file_are_refused() -> None:
    points = [waypoint(20.0 * number, 0.0) for number in range(8)]
    flight = PlannedFlight((*points, waypoint(0, 0)))
    corners = [tuple(PLACE.to_wgs84((5.0 * number, 30.0)).tolist()) for number in range(6)]
    made = replace(plan(flight), way_home=lambda _here, _home: corners)
    with pytest.raises(PaveTwinError, match="has too many corners for a file of 7 waypoints"):
        parts_of(made, flight, 7)
