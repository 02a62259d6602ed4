"""From tracks to plans, in small tracks made by hand."""

from itertools import pairwise
from math import hypot
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import FlightPlan, PlannedFlight, plan_of
from pavetwin.world.georeference import anchored, from_wgs84

PLACE = anchored(52.47, 13.44)
WORLD: Any = SimpleNamespace(name="town", georeference=PLACE)

Step = tuple[str, float, float]
"""Mode, and the place where it ends."""


def track(*steps: Step, height_m: float = 10.0) -> list[dict[str, Any]]:
    """Samples of 3 m along straight ways from mode to mode, from the origin."""
    rows: list[dict[str, Any]] = []
    x, y = 0.0, 0.0
    for mode, to_x, to_y in steps:
        count = max(1, round(hypot(to_x - x, to_y - y) / 3))
        rows += [
            {
                "x_m": x + share * (to_x - x),
                "y_m": y + share * (to_y - y),
                "altitude_m": 0.0 if mode in ("climb", "land", "swap") else height_m,
                "mode": mode,
                "segment": "s0001" if mode in ("inspect", "wait") else None,
            }
            for share in np.arange(count) / count
        ]
        x, y = to_x, to_y
    return rows


def planned(rows: list[dict[str, Any]], world: Any = WORLD) -> FlightPlan:
    spec = SimpleNamespace(settings=load_settings())
    mission: Any = SimpleNamespace(
        folder=Path("mission"), name="mission", spec=spec, track=pl.DataFrame(rows, infer_schema_length=None)
    )
    return plan_of(mission, world)


def places(flight: PlannedFlight) -> list[tuple[float, float]]:
    return [(round(float(x), 1) + 0.0, round(float(y), 1) + 0.0) for x, y in from_wgs84(PLACE, flight.lonlat)]


OUT_AND_BACK: tuple[Step, ...] = (
    *(("climb", 0, 0), ("transit", 60, 0), ("inspect", 60, 90), ("home", 0, 0), ("land", 0, 0)),
)


def test_a_pass_is_photographed_and_the_ways_to_it_are_not() -> None:
    plan = planned(track(*OUT_AND_BACK))
    (flight,) = plan.flights
    assert places(flight) == [(0, 0), (60, 0), (60, 90), (0, 0)]
    assert [each.photographs for each in flight.waypoints] == [False, True, False, False]
    assert [each.speed_mps for each in flight.waypoints[:3]] == [10, 5, 10]
    assert [each.segment for each in flight.waypoints] == [None, "s0001", None, None]
    assert {each.height_m for each in flight.waypoints} == {10}
    assert {each.corner_m for each in flight.waypoints} == {0}
    assert plan.spacing_m == pytest.approx(5 * plan.interval_s)
    assert plan.flown_at == load_settings().conditions.utc(flight.home.longitude)
    assert plan.remarks == ()


def test_each_set_of_batteries_is_a_flight() -> None:
    plan = planned(track(*OUT_AND_BACK, ("swap", 0, 0), *OUT_AND_BACK))
    assert [places(flight) for flight in plan.flights] == [[(0, 0), (60, 0), (60, 90), (0, 0)]] * 2


@pytest.mark.parametrize(
    ("reaction", "reported"),
    [
        ((("wait", 60, 40),), "waiting"),
        ((("displace", 63, 40), ("displace", 60, 40)), "displacements"),
        ((("avoid", 55, 40), ("avoid", 60, 40)), "giving way"),
    ],
)
def test_reactions_to_the_traffic_are_left_out_with_a_remark(reaction: tuple[Step, ...], reported: str) -> None:
    steps = (*OUT_AND_BACK[:2], ("inspect", 60, 40), *reaction, *OUT_AND_BACK[2:])
    plan = planned(track(*steps))
    assert places(plan.flights[0]) == [(0, 0), (60, 0), (60, 90), (0, 0)]
    assert [each.photographs for each in plan.flights[0].waypoints] == [False, True, False, False]
    assert reported in plan.remarks[0]


def test_the_way_of_a_revisit_is_kept_without_photographs() -> None:
    steps = (*OUT_AND_BACK[:3], ("revisit", 60, 30), ("revisit", 60, 30), ("home", 0, 30), ("home", 0, 0))
    plan = planned(track(*steps))
    assert places(plan.flights[0]) == [(0, 0), (60, 0), (60, 90), (60, 30), (0, 30), (0, 0)]
    assert [each.photographs for each in plan.flights[0].waypoints] == [False, True, False, False, False, False]
    assert "revisited places" in plan.remarks[0]


def test_gentle_bends_are_flown_past_and_sharp_ones_stopped_at() -> None:
    steps: tuple[Step, ...] = (("climb", 0, 0), ("transit", 60, 0), ("transit", 120, 15), ("transit", 120, 75))
    corners = [each.corner_m for each in planned(track(*steps, ("home", 0, 0))).flights[0].waypoints]
    assert corners == [0, 1, 0, 0, 0]


@given(
    ways=st.lists(
        st.tuples(st.sampled_from(["transit", "inspect"]), st.floats(-300, 300), st.floats(-300, 300)),
        min_size=1,
        max_size=12,
    )
)
def test_the_plan_follows_the_track(ways: list[Step]) -> None:
    rows = track(("climb", 0, 0), *ways, ("home", 0, 0), ("land", 0, 0))
    assume(max(hypot(row["x_m"], row["y_m"]) for row in rows) > 1)
    (flight,) = planned(rows).flights
    xy = from_wgs84(PLACE, flight.lonlat)
    flown = list(dict.fromkeys((float(row["x_m"]), float(row["y_m"])) for row in rows))
    short_leg_m = 0.6  # with the tolerance
    assert shapely.distance(shapely.LineString(xy).simplify(0), shapely.points(flown)).max() < short_leg_m
    assert shapely.distance(shapely.MultiPoint(flown), shapely.points(xy)).max() < 0.01
    assert all(hypot(*(after - before)) >= 0.49 for before, after in pairwise(xy[1:]))


@pytest.mark.parametrize("world", [SimpleNamespace(name="town", georeference=anchored(0.0, 0.0))])
def test_a_world_without_a_place_is_refused(world: Any) -> None:
    with pytest.raises(PaveTwinError, match="'town' is not georeferenced"):
        planned(track(*OUT_AND_BACK), world)
