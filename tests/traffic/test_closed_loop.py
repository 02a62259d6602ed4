"""Where the trips of the closed loop lead: to the fastest exits at densities, to all alike at levels of service."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pavetwin.traffic.closed_loop import TRIP_M, ClosedLoop, Roads, Sidewalks
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.inputs import Inputs
from scenes import tiny

EXITS = 6
TRIPS = 600


def goals(*, fastest: bool, length_m: float = TRIP_M + 1.0) -> Counter[str]:
    """The exits of many trips from one entry, to which the way to the last exit is the fastest; the way to the first
    is shorter than to the others."""

    def route(_start: str, goal: str, _kind: str, _depart: float, _mode: int) -> Any:
        number = int(goal)
        length = length_m - (300.0 if number == 0 else 0.0)
        return SimpleNamespace(edges=("entry", goal), length=length, travelTime=100.0 - number)

    count = EXITS + 1
    roads = Roads(
        ids=(*map(str, range(EXITS)), "entry"),
        length_m=np.full(count, 100.0),
        lanes=np.ones(count, dtype=np.int64),
        entries=np.array([EXITS]),
        exits=np.arange(EXITS),
        kerbsides=np.arange(count),
    )
    sumo = SimpleNamespace(simulation=SimpleNamespace(findRoute=route))
    walks = Sidewalks((), np.zeros(0), (), ())
    loop = ClosedLoop(sumo, roads, walks, 1, 0, np.random.default_rng(1), [("car", 1.0)], fastest_goals=fastest)
    return Counter(loop._trip(EXITS, "car")[-1] for _ in range(TRIPS))


def test_at_a_density_trips_lead_to_the_fastest_of_some_exits() -> None:
    assert goals(fastest=True)["5"] > 0.6 * TRIPS


def test_at_a_level_of_service_they_lead_to_all_exits_that_are_far_enough_alike() -> None:
    found = goals(fastest=False)
    assert found["0"] == 0
    assert {found[str(exit)] for exit in range(1, EXITS)} <= set(range(90, 151))


def test_where_no_exit_is_far_enough_they_lead_to_a_far_one() -> None:
    assert goals(fastest=False, length_m=TRIP_M - 50.0)["0"] < 0.01 * TRIPS


@pytest.mark.parametrize(
    ("traffic", "fastest"), [("high", True), ("v12-p40", True), ("los-C", False), ("hour-08", False)]
)
def test_levels_and_hours_prefer_no_exit(traffic: str, fastest: bool) -> None:
    assert Inputs(tiny.straight(), density_named(traffic), 0).prefers_fastest_goals is fastest
