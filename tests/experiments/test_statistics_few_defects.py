"""Means of shares of few defects: what they rest on, and intervals that hold the truth in simulations."""

import numpy as np
import polars as pl
import pytest

from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.statistics import MissionLimits, recommend, summarise
from scenes.studies import CASES, streets, study


def test_means_over_replicates_say_their_defects_and_widen_with_few() -> None:
    """Three defects a replicate, all found in all ten: resampling alone would give a share of 1."""
    table = study(replicates=10).with_columns(coverage=1.0, defects=3)
    metrics = [metric_named("coverage"), metric_named("time_s")]
    rows = summarise(table, ["traffic"], metrics).to_dicts()
    assert [row["defects"] for row in rows] == [30, None] * 2
    assert 0.7 < rows[0]["low"] < 0.9
    assert rows[0]["high"] == 1.0
    (plain,) = summarise(table.drop("defects"), [], metrics[:1]).to_dicts()
    assert (plain["low"], plain["defects"]) == (1.0, None)
    times = [row for row in rows if row["metric"] == "time_s"]
    assert times == summarise(table.drop("defects"), ["traffic"], metrics[1:]).to_dicts()


def test_the_defects_of_all_segments_of_a_mission_count_and_those_of_a_replicate_once() -> None:
    """Four segments with 6 defects each are 24 a replicate, whatever the policies; their mean is surer than that of one
    segment with 24, whose defects are hidden together."""
    one = study(replicates=6).with_columns(coverage=0.5, defects=24, segment=pl.lit("s0"))
    four = pl.concat([one.with_columns(defects=6, segment=pl.lit(f"s{at}")) for at in range(4)])
    metrics = [metric_named("coverage")]
    (of_one,), (of_four,) = (summarise(table, [], metrics).to_dicts() for table in (one, four))
    assert of_one["defects"] == of_four["defects"] == 6 * 24
    assert of_four["high"] - of_four["low"] < 0.8 * (of_one["high"] - of_one["low"])


def test_replicates_without_defects_are_in_no_coverage_and_in_every_time() -> None:
    """Three of eight replicates fly over a street without defects: coverage comes from the others."""
    table = study(replicates=8).with_columns(defects=3)
    empty = pl.col("replicate") < 3
    some = table.with_columns(
        coverage=pl.when(empty).then(None).otherwise("coverage"), defects=pl.when(empty).then(0).otherwise("defects")
    )
    chosen, of_others = (recommend(each, MissionLimits()) for each in (some, table.filter(~empty)))
    assert chosen.options["defects"].to_list() == [15] * 3
    assert chosen.options["undefined"].to_list() == [6] * 3
    for name in ("coverage", "coverage_low", "coverage_high", "defects"):
        assert chosen.options.sort("policy")[name].to_list() == of_others.options.sort("policy")[name].to_list()
    assert chosen.best is not None
    same = table.filter(policy=chosen.best["policy"], altitude_m=chosen.best["altitude_m"])
    assert chosen.best["time_s"] == pytest.approx(same["time_s"].mean())
    nothing = recommend(table.with_columns(coverage=pl.lit(None, pl.Float64), defects=0), MissionLimits())
    assert nothing.best is None
    assert nothing.sentences == ("No option has a mean of every metric that decides.",)


@pytest.mark.slow
@pytest.mark.parametrize("defects", [3, 10, 30])
@pytest.mark.parametrize("replicates", [5, 10, 20])
def test_intervals_of_a_study_hold_the_truth(replicates: int, defects: int) -> None:
    """The mean of the replicates' shares, as a report and `recommend` have it."""
    shape = (250, replicates)
    for truth, alike in CASES:
        rng = np.random.default_rng([replicates, defects, round(100 * truth), round(100 * alike)])
        found, there = streets(rng, shape[0] * replicates, defects, truth, alike)
        columns = {
            "world": "town",
            "policy": np.repeat(np.arange(shape[0]), replicates),
            "replicate": np.tile(np.arange(replicates), shape[0]),
            "status": "flown",
            "coverage": np.where(there > 0, found / np.maximum(there, 1), np.nan),
            "defects": there,
        }
        table = summarise(pl.DataFrame(columns).fill_nan(None), ["policy"], [metric_named("coverage")])
        table = table.drop_nulls("low")
        held = table.select(((pl.col("low") <= truth) & (pl.col("high") >= truth)).mean()).item()
        assert held >= 0.93, (truth, alike)
