"""Recommendations of a study for each street, from tables with a known truth."""

import polars as pl
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.statistics import MissionLimits, Objective
from pavetwin.handover.of_study import StreetAdvice, street_advice
from scenes.report_studies import table_of

FACTORS = {"traffic": ("low",), "altitude_m": (10.0,), "policy": ("baseline", "hover")}
ONE = {"traffic": ("low",), "altitude_m": (10.0,), "policy": ("hover",)}


def better(table: pl.DataFrame, policy: str, street: str, by: float) -> pl.DataFrame:
    """The same table where a policy finds more on one street."""
    there = (pl.col("street") == street) & (pl.col("policy") == policy)
    raised = (pl.col("coverage") + by).clip(0.0, 1.0)
    return table.with_columns(pl.when(there).then(raised).otherwise("coverage").alias("coverage"))


def level(table: pl.DataFrame) -> pl.DataFrame:
    """Both policies find the same, except for a little noise that follows from the row."""
    noise = (pl.int_range(pl.len()) * 37 % 11 - 5) / 1000
    return table.with_columns(coverage=0.6 + noise, time_s=pl.lit(60.0) + noise, energy=(60.0 + noise) / 1800)


def advised(table: pl.DataFrame, **levels: str) -> StreetAdvice:
    return street_advice("first", table, {}, levels, MissionLimits())


def test_a_street_that_shows_another_option_to_be_better_gets_it() -> None:
    table = better(better(level(table_of(FACTORS, 36)), "hover", "side road", -0.3), "baseline", "street road", -0.3)
    table = better(table, "baseline", "ahead road", -0.3)
    advice = advised(table)
    assert advice.option == {"altitude_m": 10.0, "policy": "hover"}
    found = {row["street"]: (row["fly"], row["from"]) for row in advice.table.iter_rows(named=True)}
    assert found["side road"] == ("baseline at 10\u00a0m", "this street")
    assert found["street road"] == found["ahead road"] == ("hover at 10\u00a0m", "the study")
    expected = table.filter(street="side road", policy="baseline")["coverage"].mean()
    assert advice.table.filter(street="side road")["expected_coverage"].item() == expected


def test_streets_without_a_difference_follow_the_study() -> None:
    advice = advised(level(table_of(FACTORS, 36)))
    assert set(advice.table["from"]) == {"the study"}
    assert advice.table["fly"].n_unique() == 1
    assert advice.table["replicates"].to_list() == [12, 12, 12]


def test_a_few_replicates_say_nothing_of_a_street() -> None:
    advice = advised(better(level(table_of(FACTORS, 9)), "baseline", "side road", -0.5))
    assert set(advice.table["from"]) == {"the study"}


def test_segments_come_in_the_order_of_the_study() -> None:
    assert advised(table_of(ONE, 3)).segments == ("street", "side", "ahead")


def test_a_handover_is_for_one_traffic() -> None:
    table = table_of({**FACTORS, "traffic": ("low", "high")}, 6)
    with pytest.raises(PaveTwinError, match="`traffic`: the study has low and high, and a handover is for one"):
        advised(table)
    with pytest.raises(PaveTwinError, match="`traffic` los-C: the study has low and high"):
        advised(table, traffic="los-C")
    assert advised(table, traffic="high").levels["traffic"] == "high"


def test_limits_that_no_option_keeps_give_nothing_to_hand_over() -> None:
    with pytest.raises(PaveTwinError, match="recommends nothing to hand over: No option keeps the limit"):
        street_advice("first", table_of(FACTORS, 6), {}, {}, MissionLimits(max_time_s=1.0))


def test_an_objective_holds_for_streets_too() -> None:
    table = table_of({**FACTORS, "altitude_m": (6.0, 10.0)}, 18)
    advice = street_advice("first", table, {}, {}, MissionLimits(min_coverage=0.1), objective=Objective.HIGHEST)
    assert all("10" in words for words in advice.table["fly"])
