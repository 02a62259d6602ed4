"""Summaries and paired differences of tables whose truth is known."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal
from scipy import stats

from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.statistics import MissionLimits, differences, effects, every_pair, recommend, summarise
from scenes.studies import PAPER, SMALL, study, without

BY = ("traffic", "altitude_m", "policy")
MAIN = [metric_named("coverage"), metric_named("time_s")]
FIRST = (pl.col("traffic") == "low") & (pl.col("policy") == "hover")


def row(frame: pl.DataFrame, **where: object) -> dict[str, object]:
    return frame.filter(**where).row(0, named=True)


def test_a_summary_agrees_with_numpy_and_scipy() -> None:
    table = study()
    values = table.filter(FIRST)["time_s"].to_numpy()
    cell = row(summarise(table, BY), traffic="low", policy="hover", metric="time_s")
    assert (cell["n"], cell["undefined"], cell["failed"]) == (20, 0, 0)
    assert cell["mean"] == pytest.approx(values.mean())
    assert cell["sd"] == pytest.approx(stats.tstd(values))
    assert cell["median"] == pytest.approx(np.median(values))
    assert cell["p95"] == pytest.approx(np.percentile(values, 95))
    assert cell["maximum"] == values.max()
    width = cell["high"] - cell["low"]
    student = stats.t.interval(0.95, 19, values.mean(), stats.sem(values))
    assert (cell["low"], cell["high"]) == pytest.approx(student, abs=0.15 * width)


def test_cells_keep_the_order_of_their_levels() -> None:
    summary = summarise(study(PAPER, 2), BY, MAIN)
    assert summary.height == 72
    assert summary["metric"].to_list()[:2] == ["coverage", "time_s"]
    assert summary["traffic"].unique(maintain_order=True).to_list() == ["low", "medium", "high"]
    assert summary["policy"].to_list()[:8:2] == ["baseline", "hover", "micro", "skip"]
    assert summary.schema["altitude_m"] == pl.Float64


def test_what_is_undefined_or_failed_is_counted_and_is_no_number() -> None:
    table = without(study(), FIRST & (pl.col("replicate") < 3), failed=False)
    table = without(table, FIRST & (pl.col("replicate") >= 18), failed=True)
    summary = summarise(table, BY)
    coverage = row(summary, traffic="low", policy="hover", metric="coverage")
    assert (coverage["n"], coverage["undefined"], coverage["failed"]) == (15, 3, 2)
    kept = study().filter(FIRST, pl.col("replicate").is_between(3, 17))["coverage"]
    assert coverage["mean"] == pytest.approx(kept.mean())
    seconds = row(summary, traffic="low", policy="hover", metric="time_s")
    assert (seconds["n"], seconds["undefined"], seconds["failed"]) == (18, 0, 2)
    compared = differences(table, BY)
    coverage = row(compared, traffic="low", policy="hover", metric="coverage")
    assert (coverage["pairs"], coverage["undefined"]) == (15, 5)


def test_a_cell_without_any_value_is_null_throughout() -> None:
    table = without(study(), FIRST, failed=True)
    cell = row(summarise(table, BY), traffic="low", policy="hover", metric="coverage")
    assert (cell["n"], cell["failed"]) == (0, 20)
    assert {cell[name] for name in ("mean", "sd", "low", "high", "median", "p95", "maximum")} == {None}
    pair = row(differences(table, BY), traffic="low", policy="hover", metric="coverage")
    assert pair["pairs"] == 0
    assert {pair[name] for name in ("mean", "low", "high", "p", "p_corrected", "dz")} == {None}


def test_a_single_replicate_has_means_and_nothing_else() -> None:
    table = study(replicates=1)
    summary = summarise(table, BY)
    assert summary["mean"].null_count() == 0
    assert summary.select("sd", "low", "high").null_count().row(0) == (summary.height,) * 3
    compared = differences(table, BY)
    assert compared["mean"].null_count() == 0
    assert compared.select("low", "high", "p", "p_corrected", "dz").null_count().row(0) == (12,) * 5


def test_nan_is_undefined_too() -> None:
    table = study().with_columns(coverage=pl.when(FIRST).then(float("nan")).otherwise(pl.col("coverage")))
    assert row(summarise(table, BY), traffic="low", policy="hover", metric="coverage")["undefined"] == 20


@pytest.mark.parametrize("replicates", [2, 3, 4, 8])
def test_small_samples_stay_within_what_a_metric_can_be(replicates: int) -> None:
    """Coverage from 0 to 1, and no time, waiting or energy below 0; differences of coverage from −1 to 1."""
    table = study(replicates=replicates)
    hidden = (pl.col("replicate") == 0) & (pl.col("policy") == "hover")
    table = table.with_columns(
        coverage=pl.when(hidden).then(0.0).otherwise(1.0), time_s=pl.when(hidden).then(900.0).otherwise(5.0)
    )
    summary, compared = summarise(table, BY), differences(table, BY)
    shares = summary.filter(pl.col("metric") == "coverage")
    assert shares.select((pl.col("low") >= 0).all(), (pl.col("high") <= 1).all()).row(0) == (True, True)
    assert summary["low"].min() >= 0
    gaps = compared.filter(metric="coverage").drop_nulls("low")
    assert (gaps.height > 0) == (replicates > 5)
    assert gaps.select((pl.col("low") >= -1).all(), (pl.col("high") <= 1).all()).row(0) == (True, True)


def test_differences_are_of_pairs() -> None:
    table = study(truth=lambda cell: {"time_s": 2.0 * (cell["policy"] == "hover")})
    wide = table.filter(traffic="high").pivot("policy", index="replicate", values="time_s")
    gaps = (wide["hover"] - wide["baseline"]).to_numpy()
    pair = row(differences(table, BY), traffic="high", policy="hover", metric="time_s")
    assert pair["mean"] == pytest.approx(gaps.mean())
    assert pair["dz"] == pytest.approx(gaps.mean() / gaps.std(ddof=1))
    assert pair["p"] == pytest.approx(stats.ttest_1samp(gaps, 0).pvalue, abs=0.02)
    alone = differences(table.filter(pl.col("policy") != "micro", traffic="high"), BY, MAIN[1:]).row(0, named=True)
    assert alone["high"] - alone["low"] == pytest.approx(2 * 2.093 * stats.sem(gaps), rel=0.15)
    assert (pair["low"], pair["high"]) < (alone["low"], alone["high"] + 10)
    assert pair["high"] - pair["low"] > alone["high"] - alone["low"]


def test_real_differences_are_found_and_others_are_not() -> None:
    levels = {**PAPER, "altitude_m": (6.0,)}
    table = study(levels, truth=lambda cell: {"coverage": 0.06 * (cell["policy"] == "hover")})
    found = differences(table, BY).filter(metric="coverage").filter(pl.col("p_corrected") < 0.05)
    assert set(found["policy"]) == {"hover"}
    assert found.height == 3


@pytest.mark.parametrize("studies", [10, pytest.param(60, marks=pytest.mark.slow)])
def test_the_family_wise_error_is_held(studies: int) -> None:
    """Studies without an effect, 4 comparisons each: one false find in twenty, within what chance allows."""
    false = [
        differences(study(seed=seed), BY, MAIN[:1]).filter(pl.col("p_corrected") < 0.05).height > 0
        for seed in range(studies)
    ]
    assert sum(false) <= stats.binom.ppf(0.999, studies, 0.05)


def test_other_factors_can_be_compared() -> None:
    table = study(PAPER, 5, lambda cell: {"coverage": 0.01 * cell["altitude_m"]})
    compared = differences(table, ("altitude_m", "policy"), MAIN, factor="altitude_m", reference=6.0)
    assert compared["altitude_m"].unique().sort().to_list() == [10.0, 15.0]
    assert row(compared, altitude_m=15.0, policy="skip", metric="coverage")["mean"] == pytest.approx(0.09, abs=0.05)
    assert row(compared, altitude_m=15.0, policy="skip", metric="coverage")["pairs"] == 5


def test_pairs_of_levels_are_one_family_stricter_than_each_reference_alone() -> None:
    table = study(PAPER, 10, lambda cell: {"coverage": 0.02 * (cell["altitude_m"] > 6)})
    low, middle = every_pair(table, ("altitude_m", "policy"), [6.0, 10.0, 15.0], factor="altitude_m")
    assert (low.reference, middle.reference) == (6.0, 10.0)
    assert low.number == middle.number == 3 * 4 * 3, "pairs of altitudes, policies, metrics"
    assert middle.differences["altitude_m"].unique().to_list() == [15.0]
    alone = differences(table, ("altitude_m", "policy"), factor="altitude_m", reference=6.0)
    assert low.differences["mean"].to_list() == alone["mean"].to_list()
    assert (low.differences["p_corrected"] >= alone["p_corrected"]).all()
    assert (low.differences["p_corrected"] > alone["p_corrected"]).any()


def test_a_reference_that_was_not_flown_gives_no_comparisons() -> None:
    compared = differences(study().filter(pl.col("policy") != "baseline"), BY)
    assert compared.height == 0
    assert compared.columns == differences(study(replicates=2), BY).columns


def test_the_compared_factor_must_be_asked_for() -> None:
    with pytest.raises(ValueError, match="factor 'policy'"):
        differences(study(), ("traffic",))


def test_worlds_and_unequal_replicates_are_paired_within_their_world() -> None:
    """Replicate 1 of one town has nothing to do with replicate 1 of the other."""
    table = study({**SMALL, "world": ("north", "south")}, 8).filter(
        (pl.col("world") == "north") | (pl.col("replicate") < 3)
    )
    compared = differences(table, BY, MAIN)
    assert compared["pairs"].unique().to_list() == [11]
    by_world = differences(table, ("world", *BY), MAIN)
    assert by_world.filter(world="south")["pairs"].unique().to_list() == [3]
    pooled = row(compared, traffic="low", policy="hover", metric="time_s")
    parts = by_world.filter(traffic="low", policy="hover", metric="time_s")
    assert pooled["mean"] == pytest.approx((parts["mean"] * parts["pairs"]).sum() / 11)


@pytest.mark.parametrize("swept", [("a", "b"), (False, True), (0.5, 0.7)])
def test_swept_columns_of_any_type(swept: tuple[object, ...]) -> None:
    table = study({**SMALL, "tau_o": swept}, 3)
    assert summarise(table, ("tau_o", "policy"), MAIN)["tau_o"].unique(maintain_order=True).to_list() == list(swept)
    compared = differences(table, ("tau_o", "policy"), MAIN, factor="tau_o", reference=swept[0])
    assert compared["tau_o"].unique().to_list() == [swept[1]]
    assert "traffic × tau_o" in effects(table, ("traffic", "tau_o"), MAIN)["term"]
    # Missions that differ in what `by` leaves out are paired one by one, and are one replicate.
    assert differences(table, ("policy",), MAIN)["pairs"].unique().to_list() == [3]


@settings(max_examples=5)
@given(st.randoms(use_true_random=False))
def test_the_order_of_rows_does_not_matter(seeds: object) -> None:
    table = study(replicates=4)
    order = list(range(table.height))
    seeds.shuffle(order)  # type: ignore[attr-defined]
    shuffled = table[order]
    for made in (
        lambda table: summarise(table, ("traffic", "policy"), MAIN),
        lambda table: differences(table, ("policy",), MAIN),
        lambda table: effects(table, ("traffic", "policy"), MAIN),
        lambda table: recommend(table, MissionLimits(max_time_s=65.0)).options,
    ):
        ordered = made(table)
        keys = [name for name in ("traffic", "altitude_m", "policy", "metric", "term") if name in ordered.columns]
        assert_frame_equal(ordered.sort(keys), made(shuffled).sort(keys), check_exact=False, rel_tol=1e-9)


def test_mirrored_differences_have_mirrored_intervals() -> None:
    table = study().filter(pl.col("policy") != "micro")
    there = differences(table, BY, MAIN)
    back = differences(table, BY, MAIN, reference="hover")
    assert (-back["mean"]).to_list() == pytest.approx(there["mean"].to_list())
    assert (-back["high"]).to_list() == pytest.approx(there["low"].to_list())
    assert back["p"].to_list() == there["p"].to_list()


def test_everything_is_repeatable_and_the_seed_counts() -> None:
    table = study(replicates=8)
    assert_frame_equal(summarise(table, BY), summarise(table, BY))
    assert_frame_equal(differences(table, BY), differences(table, BY))
    assert not summarise(table, BY)["low"].equals(summarise(table, BY, seed=1)["low"])
