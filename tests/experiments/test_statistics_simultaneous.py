"""Tests and intervals of many comparisons against scipy, by brute force, and by the law that ties them together."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from pavetwin.experiments.statistics.simultaneous import ALPHA, Pairs, Verdicts, flips, simultaneous


def verdicts(units: np.ndarray) -> Verdicts:
    return simultaneous(units, np.zeros(units.shape[1], dtype=np.intp))


def scipy_p(gaps: np.ndarray) -> float:
    own = stats.permutation_test((gaps,), np.mean, permutation_type="samples", n_resamples=np.inf)
    return float(own.pvalue)


@pytest.mark.parametrize("n", [6, 9, 11])
def test_the_ends_of_an_interval_are_where_scipys_p_falls(n: int) -> None:
    """Its test of the differences less a mean just inside reaches as often as asked for; just outside it does not."""
    assigned = flips(n, 0)
    for gaps in np.random.default_rng(n).lognormal(1, 1, (3, n)) - 2:
        for reached in (1, 3, len(assigned) // 10):
            low, high = Pairs(gaps, assigned).interval(reached, np.inf if reached == 1 else 0.0)
            if reached == 1:
                assert (low, high) == (-np.inf, np.inf)
                continue
            for end, outward in ((low, -1e-6), (high, 1e-6)):
                assert scipy_p(gaps - (end - outward)) > reached / len(assigned)
                assert scipy_p(gaps - (end + outward)) <= reached / len(assigned)


def test_the_correction_agrees_with_brute_force() -> None:
    """Every assignment, every comparison: how rare is what is rarest of it, by p and then by Student's t."""
    units = np.random.default_rng(4).normal(0.5, 1, (5, 7)) + np.random.default_rng(5).normal(0, 1, 7)
    rest = units - units.mean(axis=1, keepdims=True)
    signs = [np.array([*head, 1.0]) for head in product([1.0, -1.0], repeat=6)]

    def rarity(gaps: np.ndarray) -> tuple[float, float]:
        return round(scipy_p(gaps), 9), -abs(float(stats.ttest_1samp(gaps, 0).statistic))

    rarest = sorted(min(rarity(sign * row) for row in rest) for sign in signs)
    found = Pairs(units[0], flips(7, 0)), verdicts(units)
    assert found[0].t == pytest.approx(abs(stats.ttest_1samp(units[0], 0).statistic))
    for row, p, corrected in zip(units, found[1].p, found[1].p_corrected, strict=True):
        own = rarity(row)
        assert p == pytest.approx(own[0])
        expected = max((sum(chance <= own for chance in rarest) + 1) / 64, own[0])
        assert corrected >= expected - 1e-9  # the bootstrap may be the stricter of the two


FAMILIES = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 4), st.integers(2, 9)),
    elements=st.one_of(st.integers(-3, 5).map(float), st.floats(-1, 4).map(lambda value: round(value, 2))),
)


@settings(max_examples=60, deadline=None)
@given(FAMILIES)
def test_an_interval_excludes_0_just_where_its_corrected_p_is_small(units: np.ndarray) -> None:
    found = verdicts(units)
    off = (found.low > 0) | (found.high < 0)
    assert off.tolist() == (found.p_corrected < ALPHA).tolist()
    assert (found.low <= units.mean(axis=1) + 1e-9).all()
    assert (found.high >= units.mean(axis=1) - 1e-9).all()
    assert (found.p_corrected >= found.p - 1e-12).all()


@pytest.mark.parametrize("families", [40, pytest.param(200, marks=pytest.mark.slow)])
def test_all_intervals_of_a_family_hold_their_means_at_their_rate(families: int) -> None:
    """12 comparisons that share their replicates, families of 10: 95 in a hundred, within what chance allows."""
    rng = np.random.default_rng(7)
    held = 0
    for _ in range(families):
        found = verdicts(rng.normal(size=(12, 10)) + rng.normal(size=10) + 3.0)
        held += bool(((found.low <= 3.0) & (found.high >= 3.0)).all())
    assert held >= stats.binom.ppf(0.001, families, 0.95)


def test_more_comparisons_have_wider_intervals() -> None:
    units = np.random.default_rng(2).normal(size=(30, 16))
    alone, together = verdicts(units[:1]), verdicts(units)
    assert together.low[0] < alone.low[0] < alone.high[0] < together.high[0]
    assert together.p_corrected[0] >= alone.p_corrected[0]


def test_five_pairs_exclude_nothing_and_equal_ones_have_one_value() -> None:
    found = verdicts(np.full((2, 5), 4.0))
    assert np.isinf(found.low).all()
    assert (found.p_corrected >= ALPHA).all()
    equal = verdicts(np.full((2, 8), 4.0))
    assert equal.low.tolist() == equal.high.tolist() == [4.0, 4.0]
    assert (equal.p_corrected < ALPHA).all()
    nothing = verdicts(np.zeros((1, 8)))
    assert (nothing.low[0], nothing.high[0], nothing.p[0], nothing.p_corrected[0]) == (0.0, 0.0, 1.0, 1.0)


def test_what_has_no_pairs_is_not_tested() -> None:
    units = np.random.default_rng(3).normal(size=(3, 8))
    units[1, 1:] = np.nan
    units[2, 4] = np.nan
    found = verdicts(units)
    assert np.isnan(found.p_corrected).tolist() == np.isnan(found.low).tolist() == [False, True, False]
    assert np.isnan(verdicts(np.empty((0, 4))).p).tolist() == []
