"""Intervals, tests and corrections against scipy, statsmodels and their own laws."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats
from statsmodels.stats.multitest import multipletests

from pavetwin.experiments.statistics.bootstrap import intervals
from pavetwin.experiments.statistics.effects import holm
from pavetwin.experiments.statistics.simultaneous import EXACT, sign_flip_p

Draw = Callable[[np.random.Generator, tuple[int, int]], np.ndarray]


def limits(units: np.ndarray, worlds: np.ndarray | None = None, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    return intervals(units, np.zeros(units.shape[1], dtype=np.intp) if worlds is None else worlds, seed)


def _waiting(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    return np.where(rng.random(shape) < 0.6, 0.0, rng.lognormal(3, 1, shape))


def _shares(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Shares of 6 defects, found with a chance that varies from street to street around 0.95: most are 1."""
    return rng.binomial(6, rng.beta(7.6, 0.4, shape)) / 6


# Distribution, replicates, true mean, and how often of a hundred the interval holds it.
KINDS: dict[str, tuple[Draw, int, float, tuple[float, float]]] = {
    "normal, 20": (lambda rng, shape: rng.normal(0, 1, shape), 20, 0.0, (93.5, 96.5)),
    "normal, 10": (lambda rng, shape: rng.normal(0, 1, shape), 10, 0.0, (92.5, 96.0)),
    "normal, 5": (lambda rng, shape: rng.normal(0, 1, shape), 5, 0.0, (90.0, 95.0)),
    "heavy, 20": (lambda rng, shape: rng.standard_t(3, shape), 20, 0.0, (90.0, 97.0)),
    "lognormal, 20": (lambda rng, shape: rng.lognormal(0, 0.6, shape), 20, float(np.exp(0.18)), (91.0, 96.0)),
    "waiting, 20": (_waiting, 20, float(0.4 * np.exp(3.5)), (90.0, 96.0)),
    "shares, 20": (_shares, 20, 0.95, (92.0, 98.0)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_the_truth_at_their_rate(kind: str) -> None:
    draw, n, truth, (least, most) = KINDS[kind]
    low, high = limits(draw(np.random.default_rng(3), (2000, n)))
    held = 100 * np.mean((low <= truth) & (truth <= high))
    assert least <= held <= most


def test_intervals_agree_with_scipy_on_normal_values() -> None:
    values = np.random.default_rng(1).normal(50, 5, 40)
    (low,), (high,) = limits(values[np.newaxis])
    own = stats.bootstrap((values,), np.mean, method="BCa", rng=np.random.default_rng(0)).confidence_interval
    student = stats.t.interval(0.95, 39, values.mean(), stats.sem(values))
    width = own.high - own.low
    assert [low, high] == pytest.approx([own.low, own.high], abs=0.12 * width)
    assert [low, high] == pytest.approx(student, abs=0.05 * width)


def test_equal_values_have_an_interval_of_one_value() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        low, high = limits(np.array([[0.7] * 7, [1.0] * 7, [0.0] * 7]))
    assert low.tolist() == high.tolist() == [0.7, 1.0, 0.0]


def test_one_replicate_has_no_interval() -> None:
    low, high = limits(np.array([[0.3, np.nan], [np.nan, np.nan], [0.1, 0.2]]))
    assert np.isnan(low).tolist() == np.isnan(high).tolist() == [True, True, False]


def test_replicates_are_resampled_within_their_world() -> None:
    """Two worlds that differ much and vary little: the difference between them is not chance."""
    rng = np.random.default_rng(0)
    units = np.concatenate([rng.normal(0, 1, 12), rng.normal(100, 1, 12)])[np.newaxis]
    low, high = limits(units, np.repeat([0, 1], 12))
    assert high[0] - low[0] < 1.3
    low, high = limits(units)
    assert high[0] - low[0] > 30


def test_an_interval_does_not_depend_on_its_neighbours() -> None:
    units = np.random.default_rng(0).normal(size=(100, 9))
    units[::3, 4] = np.nan
    together, alone = limits(units), limits(units[41:42])
    assert (together[0][41], together[1][41]) == pytest.approx((alone[0][0], alone[1][0]), rel=1e-12)


VALUES = hnp.arrays(
    np.float64,
    st.tuples(st.integers(1, 3), st.integers(2, 9)),
    elements=st.floats(-100, 100).map(lambda value: round(value, 3)),
)


@given(VALUES, st.floats(-1e3, 1e3))
def test_shifted_values_have_shifted_intervals(values: np.ndarray, shift: float) -> None:
    low, high = limits(values)
    shifted_low, shifted_high = limits(values + shift)
    assert shifted_low - shift == pytest.approx(low, abs=1e-6)
    assert shifted_high - shift == pytest.approx(high, abs=1e-6)


@given(VALUES)
def test_mirrored_values_have_mirrored_intervals(values: np.ndarray) -> None:
    low, high = limits(values)
    mirrored_low, mirrored_high = limits(-values)
    assert -mirrored_high == pytest.approx(low, abs=1e-9)
    assert -mirrored_low == pytest.approx(high, abs=1e-9)
    assert (low <= values.mean(axis=1) + 1e-9).all()
    assert (high >= values.mean(axis=1) - 1e-9).all()


@pytest.mark.parametrize("n", [2, 5, 10, 13])
def test_the_exact_test_agrees_with_scipy(n: int) -> None:
    gaps = np.random.default_rng(n).normal(0.4, 1, (3, n)).round(1)
    for row, p in zip(gaps, sign_flip_p(gaps), strict=True):
        own = stats.permutation_test(
            (row,), np.mean, permutation_type="samples", n_resamples=np.inf, alternative="two-sided"
        )
        assert p == pytest.approx(own.pvalue, abs=1e-12)


def test_differences_of_nothing_leave_the_test_exact() -> None:
    gaps = np.random.default_rng(2).normal(0.4, 1, (2, 10)).round(1)
    among_zeros = np.concatenate([gaps, np.zeros((2, 6))], axis=1)
    assert among_zeros.shape[1] == EXACT
    assert sign_flip_p(among_zeros).tolist() == sign_flip_p(gaps).tolist()
    assert sign_flip_p(np.zeros((1, 5))).tolist() == [1.0]
    assert np.isnan(sign_flip_p(np.array([[0.3, np.nan, np.nan]]))).all()


def test_the_drawn_test_agrees_with_the_exact_one_and_with_scipy() -> None:
    gaps = np.random.default_rng(0).normal(0.35, 1, (4, 20))
    for row, p in zip(gaps, sign_flip_p(gaps), strict=True):
        own = stats.permutation_test(
            (row,), np.mean, permutation_type="samples", n_resamples=40_000, rng=np.random.default_rng(1)
        )
        assert p == pytest.approx(own.pvalue, abs=0.012)
        assert p == pytest.approx(stats.ttest_1samp(row, 0).pvalue, abs=0.03)


def test_equal_sums_in_other_last_bits_count_as_equal() -> None:
    """0.1 + 0.2 and 0.3 differ in floating point; 2 of the 8 assignments reach the mean, and 0 is reached by all."""
    assert sign_flip_p(np.array([[0.1, 0.2, 0.3], [0.1 + 0.2, -0.3, 0.0]])).tolist() == [0.25, 1.0]


@pytest.mark.slow
@settings(max_examples=30)
@given(hnp.arrays(np.float64, st.integers(1, 30), elements=st.floats(0, 1)))
def test_holm_agrees_with_statsmodels(p: np.ndarray) -> None:
    corrected = holm(p)
    assert corrected == pytest.approx(multipletests(p, method="holm")[1])
    assert (corrected >= p).all()
    assert (corrected <= 1).all()


def test_holm_leaves_out_what_was_not_tested() -> None:
    corrected = holm(np.array([0.01, np.nan, 0.03]))
    assert corrected[[0, 2]] == pytest.approx([0.02, 0.03])
    assert np.isnan(corrected[1])
