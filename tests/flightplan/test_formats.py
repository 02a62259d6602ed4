"""Plans in every format, read back by readers of their own."""

import io
import re
import time
import zipfile
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from flightplan.readers import READERS
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import PLAN_FORMATS, FlightPlan, PlannedFlight, Trigger, Waypoint

GEOD = Geod(ellps="WGS84")

finite = {"allow_nan": False, "allow_infinity": False}


@st.composite
def flights(draw: st.DrawFn) -> PlannedFlight:
    longitude, latitude = draw(st.floats(-179, 179, **finite)), draw(st.floats(-79, 79, **finite))
    legs = draw(st.lists(st.tuples(st.floats(0, 360), st.floats(0.5, 400), st.booleans()), min_size=1, max_size=250))
    height_m = draw(st.floats(5, 120).map(lambda metres: round(metres, 2)))
    waypoints = []
    for heading_deg, length_m, photographs in [*legs, (0.0, 1.0, False)]:
        waypoints.append(
            Waypoint(
                longitude=longitude,
                latitude=latitude,
                height_m=height_m,
                speed_mps=5.0 if photographs else 10.0,
                photographs=photographs,
                corner_m=0.2 if photographs else 0.0,
                segment="s0001" if photographs else None,
            )
        )
        longitude, latitude, _ = GEOD.fwd(longitude, latitude, heading_deg, length_m)
    return PlannedFlight(tuple(waypoints))


def plan(flight: PlannedFlight, trigger: Trigger = Trigger.DISTANCE) -> FlightPlan:
    return FlightPlan("m", "mavic3e", (flight,), interval_s=1.4, spacing_m=3.5, trigger=trigger)


def test_every_format_has_a_reader() -> None:
    assert sorted(READERS) == sorted(PLAN_FORMATS.names())


@pytest.mark.parametrize("name", sorted(READERS))
@given(flight=flights(), trigger=st.sampled_from(Trigger))
def test_a_flight_is_read_back_as_it_is(name: str, flight: PlannedFlight, trigger: Trigger) -> None:
    made = PLAN_FORMATS.get(name)()
    back = READERS[name](made.write(plan(flight, trigger), flight))
    assert len(back) == len(flight.waypoints)
    for there, here in zip(back, flight.waypoints, strict=True):
        _, _, away_m = GEOD.inv(there.longitude, there.latitude, here.longitude, here.latitude)
        assert away_m < 0.1
        assert abs(there.height_m - here.height_m) < 0.01
    for there, here in zip(back[:-1], flight.waypoints[:-1], strict=True):
        assert there.speed_mps == here.speed_mps
        assert there.photographs is here.photographs
        assert there.stops is (here.corner_m == 0)
        assert there.every == ((3.5 if trigger is Trigger.DISTANCE else 1.4) if here.photographs else None)


def straight() -> PlannedFlight:
    return PlannedFlight(
        tuple(
            Waypoint(13.4 + 0.001 * i, 52.5, 10.0, 5.0, photographs=i == 0, corner_m=0.0, segment=None)
            for i in range(2)
        )
    )


@pytest.mark.parametrize(
    ("drone", "numbers"),
    [
        ("mavic3e", ("77", "0", "66", "0")),
        ("matrice30", ("67", "0", "52", "0")),
        ("matrice350", ("89", "0", "50", "1")),
    ],
)
def test_the_aircraft_is_named_in_djis_numbers(drone: str, numbers: tuple[str, ...]) -> None:
    content = PLAN_FORMATS.get("wpml")(drone).write(plan(straight()), straight())
    keys = ("droneEnumValue", "droneSubEnumValue", "payloadEnumValue", "payloadSubEnumValue")
    assert tuple(values_of_wpml(content, key)[0] for key in keys) == numbers


def values_of_wpml(content: bytes, key: str) -> list[str]:
    """Texts of an element in both files of the archive."""
    archive = zipfile.ZipFile(io.BytesIO(content))
    return [
        text for name in archive.namelist() for text in re.findall(rf"<wpml:{key}>(.*)</", archive.read(name).decode())
    ]


@pytest.mark.parametrize(("height_m", "climbed"), [(37.5, "37.5"), (1.0, "1.2")])
def test_a_dji_aircraft_climbs_to_the_height_of_the_route_first(height_m: float, climbed: str) -> None:
    flight = PlannedFlight(tuple(replace(each, height_m=height_m) for each in straight().waypoints))
    content = PLAN_FORMATS.get("wpml")().write(plan(flight), flight)
    assert values_of_wpml(content, "takeOffSecurityHeight") == [climbed, climbed]


@pytest.mark.parametrize("speed_mps", [0.99, 15.01])
@pytest.mark.parametrize(("number", "setting"), [(0, "uav.inspect_speed_mps"), (1, "uav.transit_speed_mps")])
def test_speeds_outside_djis_range_are_refused(number: int, setting: str, speed_mps: float) -> None:
    waypoints = list(straight().waypoints)
    waypoints[number] = replace(waypoints[number], speed_mps=speed_mps)
    flight = PlannedFlight(tuple(waypoints))
    with pytest.raises(PaveTwinError, match=rf"^`{setting}` {speed_mps:g}: DJI's plans hold speeds of 1 to 15 m/s"):
        PLAN_FORMATS.get("wpml")().write(plan(flight), flight)


@pytest.mark.parametrize("speed_mps", [1.0, 15.0])
def test_the_ends_of_djis_range_of_speeds_are_written(speed_mps: float) -> None:
    flight = PlannedFlight(tuple(replace(each, speed_mps=speed_mps) for each in straight().waypoints))
    content = PLAN_FORMATS.get("wpml")().write(plan(flight), flight)
    assert set(values_of_wpml(content, "waypointSpeed")) == {f"{speed_mps:g}"}


def test_litchi_refuses_an_interval_shorter_than_its_least() -> None:
    quick = replace(plan(straight(), Trigger.TIME), interval_s=0.9)
    with pytest.raises(
        PaveTwinError, match=r"^`trigger` time: the mission photographs every 0\.9 s, and Litchi every 1 s"
    ):
        PLAN_FORMATS.get("litchi")().write(quick, straight())
    PLAN_FORMATS.get("litchi")().write(replace(quick, trigger=Trigger.DISTANCE), straight())
    PLAN_FORMATS.get("litchi")().write(replace(quick, interval_s=1.0), straight())


def test_an_aircraft_that_dji_has_no_number_for_is_refused() -> None:
    with pytest.raises(PaveTwinError, match=r"`drone`: no drone of DJI's plans 'mavic3' \(did you mean 'mavic3e'\?\)"):
        PLAN_FORMATS.get("wpml")("mavic3").write(plan(straight()), straight())


def test_headings_are_true_and_times_follow_speeds() -> None:
    flight = straight()
    assert flight.headings_deg == pytest.approx([90, 90], abs=0.01)
    assert flight.duration_s == pytest.approx(flight.distance_m / 5)


def test_equal_plans_are_equal_bytes_whenever_they_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """The creation time in DJI's plans is the mission's, by its conditions."""
    written = []
    for now_s in (1.7e9, 1.8e9):
        monkeypatch.setattr(time, "time", lambda now_s=now_s: now_s)
        made = replace(plan(straight()), flown_at=datetime(2026, 5, 4, 8, tzinfo=UTC))
        written.append({name: PLAN_FORMATS.get(name)().write(made, straight()) for name in PLAN_FORMATS.names()})
    assert written[0] == written[1]
    created_s = datetime(2026, 5, 4, 8, tzinfo=UTC).timestamp()
    assert values_of_wpml(written[0]["wpml"], "createTime") == [f"{1000 * created_s:.0f}"]
