"""What an area has of its town's traffic: trips cut to it, how many vehicles are there, and how they leave."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.traffic.job import SLOWEST_MPS, AreaTraffic, Trip

LENGTH_M = dict.fromkeys("ABCDEF", 100.0)


def traffic(*trips: Trip, area: str = "BC", duration_s: float = 100.0) -> AreaTraffic:
    return AreaTraffic.of(trips, set(area), duration_s, LENGTH_M)


def trip(edges: str, *entered_s: float, left_s: float) -> Trip:
    return Trip("car", tuple(edges), entered_s, left_s)


def test_a_trip_is_cut_to_the_area_with_the_edges_before_and_behind_it() -> None:
    (part,) = traffic(trip("FABCDE", 10, 20, 30, 40, 50, 60, left_s=70)).trips
    assert part.edges == ("A", "B", "C", "D")
    assert part.entered_s == (20, 30, 40, 50, 60)
    assert part.is_new
    assert not part.departs


def test_a_trip_that_begins_and_ends_in_the_area_departs_there() -> None:
    (part,) = traffic(trip("BC", 10, 30, left_s=55)).trips
    assert part.edges == ("B", "C")
    assert part.entered_s == (10, 30, 55)
    assert part.departs


def test_a_trip_that_comes_back_is_cut_into_two() -> None:
    parts = traffic(trip("ABDEFCA", 0.5, 10, 20, 30, 40, 50, 60, left_s=70)).trips
    assert [part.edges for part in parts] == [("A", "B", "D"), ("F", "C", "A")]


def test_who_was_there_before_is_present_but_does_not_enter() -> None:
    found = traffic(trip("ABCD", -inf, -inf, 20, 30, left_s=40))
    assert not found.trips[0].is_new
    assert found.present[:41] == (1,) * 40 + (0,)


def test_who_has_not_arrived_keeps_the_rest_of_the_way() -> None:
    found = traffic(trip("ABCD", 10, 20, inf, inf, left_s=100))
    (part,) = found.trips
    assert part.edges == ("A", "B", "C", "D")
    assert part.entered_s == (10, 20, 100, 100, 100)
    assert traffic(trip("AFBC", 10, 20, inf, inf, left_s=100)).trips[0].edges == ("F", "B", "C")
    assert not traffic(trip("AEFBC", 10, inf, inf, inf, inf, left_s=100)).trips


def test_nobody_is_on_streets_without_trips() -> None:
    found = traffic(trip("DEF", 10, 20, 30, left_s=40))
    assert (found.trips, found.vehicles, found.speed_mps) == ((), 0.0, {})


def test_behind_the_area_vehicles_are_as_fast_as_the_towns() -> None:
    through = trip("ABCD", 10, 20, 30, 40, left_s=60)
    assert traffic(through).speed_mps == {"D": 5.0}
    others = trip("ED", 10, 20, left_s=60)
    assert traffic(through, others).speed_mps["D"] == pytest.approx(200 / 60)
    stuck = trip("CDA", 1, 2, inf, left_s=100)
    assert traffic(stuck).speed_mps == {"D": SLOWEST_MPS}


@given(
    st.lists(
        st.tuples(st.permutations("ABCDEF"), st.lists(st.integers(1, 40), min_size=7, max_size=7)),
        min_size=1,
        max_size=8,
    ),
    st.sets(st.sampled_from("ABCDEF"), min_size=1),
)
def test_the_time_that_trips_spend_on_an_area_is_kept(
    driven: list[tuple[list[str], list[int]]], area: set[str]
) -> None:
    trips, spent = [], 0.0
    for edges, steps in driven:
        times = [float(sum(steps[: at + 1])) for at in range(7)]
        trips.append(Trip("car", tuple(edges), tuple(times[:6]), times[6]))
        spent += sum(times[at + 1] - times[at] for at in range(6) if edges[at] in area)
    found = AreaTraffic.of(trips, area, 400.0, LENGTH_M)
    parts = [(part, at) for part in found.trips for at in range(len(part.edges))]
    inside = sum(part.entered_s[at + 1] - part.entered_s[at] for part, at in parts if part.edges[at] in area)
    assert inside == pytest.approx(spent)
    assert sum(found.present) == pytest.approx(sum(part.entered_s[-1] - part.entered_s[0] for part in found.trips))
