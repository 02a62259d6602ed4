"""The winner's curse: true means are shrunk, claims hold in simulated studies, and nothing depends on names."""

import numpy as np
import polars as pl
import pytest
from benchmarks.calibration import ALTITUDE, KINDS, OPTIONS, POLICY, outcomes
from hypothesis import given, settings
from hypothesis import strategies as st

from pavetwin.experiments.statistics.choice import Chances, MissionLimits, TrueMeans, choice_under, true_means

LEVELS = (ALTITUDE, POLICY)


def of(units: np.ndarray, seed: int = 0) -> TrueMeans:
    return true_means(units, np.zeros(units.shape[1], dtype=np.intp), LEVELS, seed)


def noise(seed: int, replicates: int = 12) -> np.ndarray:
    """Options that differ by chance alone, on streets that differ more."""
    rng = np.random.default_rng(seed)
    return 0.8 + rng.normal(0, 0.05, replicates) + rng.normal(0, 0.02, (OPTIONS, replicates))


def test_pure_noise_shrinks_together_and_clear_effects_stay() -> None:
    same, effects = noise(1), noise(1) + np.where(ALTITUDE == 2, 0.2, 0.0)[:, np.newaxis]
    assert np.ptp(of(same).expected) < 0.6 * np.ptp(same.mean(axis=1))
    shown = of(effects).expected
    assert shown[ALTITUDE == 2].mean() - shown[ALTITUDE < 2].mean() == pytest.approx(0.2, abs=0.02)


def test_the_average_of_all_options_is_not_shrunk() -> None:
    units = noise(2)
    assert of(units).expected.mean() == pytest.approx(units.mean())
    assert of(units).draws.mean() == pytest.approx(units.mean(), abs=0.002)


def test_the_best_mean_of_equal_options_is_not_believed() -> None:
    """Over many studies the best observed mean is too high; what is expected of it much less so."""
    raw, corrected = [], []
    for seed in range(20):
        units = noise(seed)
        best = int(units.mean(axis=1).argmax())
        raw.append(units.mean(axis=1)[best] - units.mean())
        corrected.append(of(units).expected[best] - units.mean())
    assert np.mean(raw) > 0.007
    assert np.mean(corrected) < 0.55 * np.mean(raw)


@given(st.integers(0, 10**6), st.floats(-3, 3), st.floats(0.01, 100))
@settings(max_examples=6)
def test_units_and_zero_do_not_matter(seed: int, shift: float, scale: float) -> None:
    units = noise(seed)
    plain, moved = of(units), of(shift + scale * units)
    np.testing.assert_allclose(moved.expected, shift + scale * plain.expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(moved.draws, shift + scale * plain.draws, rtol=1e-6, atol=1e-5 * scale)


def chances(units: np.ndarray) -> Chances:
    options, replicates = units.shape[1:]
    levels = [np.arange(options)]
    return choice_under(MissionLimits(), units, np.zeros(replicates, dtype=np.intp), levels, seed=0)


def test_options_equal_in_everything_in_every_replicate_count_once() -> None:
    units = np.stack([noise(3)[:4], 60 + noise(4)[:4], noise(5)[:4]])
    made, alone = chances(np.concatenate([units, units[:, 1:2]], axis=1)), chances(units)
    assert made.certainty[1] == made.certainty[4] > 0
    np.testing.assert_allclose(made.certainty[:4], alone.certainty)


def test_options_that_were_level_in_few_replicates_may_differ_in_others() -> None:
    """The best two found the same in each of 10 replicates: the cheaper one is not sure to be the best."""
    coverage = noise(6, 10)[:4] + np.array([0.3, 0.3, 0.0, 0.0])[:, np.newaxis]
    coverage[1] = coverage[0]
    time_s = np.tile([[70.0], [75.0], [70.0], [75.0]], 10)
    best, level, *others = chances(np.stack([coverage, time_s, time_s / 1800])).certainty
    assert best + level == pytest.approx(1.0)
    assert 0.3 < best < 0.7
    assert others == [0.0, 0.0]


def test_what_is_undefined_stays_so_and_the_others_do_without_it() -> None:
    units = noise(4)
    units[5], units[2, :3] = np.nan, np.nan
    made = of(units)
    assert np.isnan(made.expected).tolist() == [at == 5 for at in range(OPTIONS)]
    assert np.isfinite(made.draws[:, np.arange(OPTIONS) != 5]).all()
    alone = true_means(np.full((1, 6), 0.5), np.zeros(6, dtype=np.intp), [np.array([0])], 0)
    assert alone.expected.tolist() == [0.5]


@pytest.mark.slow
def test_claims_hold_in_simulated_studies_and_those_of_resampling_alone_did_not() -> None:
    """Over 24 studies of each kind: how sure `recommend` was on average against how often it was right."""
    rows = pl.DataFrame(list(outcomes(12))).with_columns(pl.col("right").cast(pl.Float64))

    def too_sure(of: pl.DataFrame, claim: str = "shrunk") -> float:
        return float(of[claim].mean() - of["right"].mean())

    by_kind = {kind: too_sure(rows.filter(kind=kind)) for kind in KINDS}
    assert rows.height > 160
    assert max(by_kind.values()) < 0.12, by_kind
    ties = rows.filter(pl.col("kind").is_in(["as in the paper's study", "near ties", "nearly equal"]))
    assert too_sure(ties) < 0.06
    assert too_sure(rows, "resampled") > 0.09
    assert -0.12 < too_sure(rows) < 0.05
    assert too_sure(rows.filter(pl.col("shrunk") >= 0.6)) < 0.03
    assert rows["error_resampled"].mean() > 0.007
    assert abs(rows["error_shrunk"].mean()) < 0.005
