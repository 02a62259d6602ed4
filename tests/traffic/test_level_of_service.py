"""Levels of service: the Highway Capacity Manual's thresholds, and what a user may call traffic."""

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import (
    DENSITIES,
    HOURLY_SHARES,
    LEVEL_PEDESTRIANS,
    LevelOfService,
    density_named,
    hour_density,
    level_density,
    level_of,
    share_of_busiest,
)


@pytest.mark.parametrize(
    ("ratio", "level"),
    [
        *((1.1, "A"), (0.81, "A"), (0.80, "B"), (0.68, "B"), (0.67, "C"), (0.51, "C"), (0.50, "D"), (0.41, "D")),
        *((0.40, "E"), (0.31, "E"), (0.30, "F"), (0.0, "F")),
    ],
)
def test_the_thresholds_are_those_of_the_manual(ratio: float, level: str) -> None:
    assert level_of(ratio) == level
    assert [each for each in LevelOfService if each.holds(ratio)] == ([level] if ratio > 0 else [])


def test_the_target_is_the_middle_of_what_a_network_can_reach() -> None:
    assert LevelOfService.C.target(0.72) == pytest.approx(0.585)
    assert LevelOfService.B.target(0.72) == pytest.approx((0.67 + 0.72) / 2)
    assert LevelOfService.A.target(0.95) == pytest.approx((0.80 + 0.95) / 2)
    assert LevelOfService.F.target(0.72) == pytest.approx(0.20)
    assert LevelOfService.F.target(0.24) == pytest.approx(0.16)


def test_a_name_holds_level_hour_and_mix() -> None:
    asked = density_named("los-c+south_asia")
    assert (asked.level, asked.hour, asked.mix, asked.is_found) == (LevelOfService.C, None, "south_asia", True)
    assert asked.vehicles_per_lane_km is None
    assert density_named("los-C", "south_asia") == asked == density_named(asked.name)
    assert density_named("hour-8").name == "hour-08"
    assert density_named("high+east_asia").vehicles_per_lane_km == 30
    assert density_named("high") is DENSITIES["high"]
    assert not density_named("high").is_found
    assert density_named("high", "europe") is DENSITIES["high"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("los-G", "no level of service 'G'.*known are A, B, C, D, E, F"),
        ("hour-24", "expected a whole number from 0 to 23"),
        ("los-C+asia", r"no mix of vehicles 'asia' \(did you mean '\w*asia'\?\)"),
        ("loss-C", r"did you mean 'los-C'\?"),
    ],
)
def test_an_unknown_name_gets_a_hint(name: str, said: str) -> None:
    with pytest.raises(PaveTwinError, match=said):
        density_named(name)


def test_two_mixes_contradict_each_other() -> None:
    with pytest.raises(PaveTwinError, match="has the mix south_asia"):
        density_named("los-C+south_asia", "east_asia")


def test_the_daily_curve_is_a_whole_day() -> None:
    assert len(HOURLY_SHARES) == 24
    assert sum(HOURLY_SHARES) == pytest.approx(100.0, abs=0.5)
    assert share_of_busiest(17) == 1.0
    assert share_of_busiest(3) < 0.04
    assert hour_density(3).pedestrians_per_sidewalk_km < 0.05 * level_density("C").pedestrians_per_sidewalk_km
    assert level_density("E").pedestrians_per_sidewalk_km == LEVEL_PEDESTRIANS
