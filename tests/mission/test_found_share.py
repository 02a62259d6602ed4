"""Shares of found defects: intervals widen where defects are few or alike, and hold the truth in simulations."""

import numpy as np
import pytest
from scipy.stats import binomtest

from pavetwin.mission.metrics import FoundShare, found_share
from scenes.few_defects import CASES, streets


def width(found: list[int], defects: list[int]) -> float:
    known = share(found, defects)
    return known.high - known.low


def share(found: list[int], defects: list[int]) -> FoundShare:
    known = found_share(found, defects)
    assert known is not None
    return known


def test_fewer_defects_fewer_streets_and_streets_that_differ_widen_the_interval() -> None:
    assert width([8] * 10, [10] * 10) < width([4] * 10, [5] * 10) < width([4] * 5, [5] * 5) < width([4], [5])
    assert width([8] * 10, [10] * 10) < width([10, 6] * 5, [10] * 10) < width([10] * 8 + [0] * 2, [10] * 10)


def test_streets_without_defects_say_nothing() -> None:
    assert found_share([0, 0], [0, 0]) is None
    assert share([3, 0, 5], [4, 0, 6]) == share([3, 5], [4, 6])
    assert (share([3, 5], [4, 6]).share, share([3, 5], [4, 6]).defects) == (0.8, 10)


def test_what_was_always_or_never_found_is_not_certain() -> None:
    always, never = share([3, 3, 3], [3, 3, 3]), share([0, 0, 0], [3, 3, 3])
    assert always.high == 1.0
    assert 0.4 < always.low < 0.75
    assert (never.low, never.high) == pytest.approx((0.0, 1 - always.low))


def test_an_interval_is_no_shorter_than_of_independent_defects() -> None:
    """One defect a street is nothing but independent draws: Clopper and Pearson's interval, a little wider."""
    found = [1] * 34 + [0] * 6
    ours, exact = share(found, [1] * 40), binomtest(34, 40).proportion_ci()
    assert ours.low == pytest.approx(exact.low, abs=0.01)
    assert ours.low <= exact.low < exact.high <= ours.high


@pytest.mark.slow
@pytest.mark.parametrize("defects", [3, 10, 30])
@pytest.mark.parametrize("count", [1, 4, 10, 20])
def test_intervals_of_one_mission_hold_the_truth(count: int, defects: int) -> None:
    """Nominally 95 of 100, for 3, 10 and 30 defects a street."""
    for truth, alike in CASES:
        rng = np.random.default_rng([count, defects, round(100 * truth), round(100 * alike)])
        drawn = [streets(rng, count, defects, truth, alike) for _ in range(500)]
        known = [found_share(found.tolist(), there.tolist()) for found, there in drawn if there.any()]
        assert np.mean([each.low <= truth <= each.high for each in known]) >= 0.93, (truth, alike)
