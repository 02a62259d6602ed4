"""The answer of a report: its table of differences, and the proposal for each traffic."""

from typing import Any

import polars as pl
import pytest
from scipy import stats

from pavetwin.experiments.report.proposals import answer_section, findings_section
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.statistics import MissionLimits
from pavetwin.reports.blocks import Table
from pavetwin.reports.words import MISSING
from scenes.studies import PAPER, SMALL, study, without


def rows_of(section: Any, at: int = 0) -> list[list[str]]:
    table = section.blocks[at]
    assert isinstance(table, Table)
    return [[cell.text for cell in row] for row in table.rows]


def found(table: pl.DataFrame) -> list[list[str]]:
    return rows_of(findings_section(gather("Found", {}, table, {})))


def hover_helps_in_high_traffic(cell: dict[str, Any]) -> dict[str, float]:
    busy = cell["traffic"] == "high"
    added = {"hover": (0.06, 30.0), "skip": (-0.05, 0.0)}.get(cell["policy"], (0.0, 0.0))
    return {"coverage": added[0] * busy, "time_s": added[1] * busy}


def test_a_row_counts_the_settings_with_a_difference_and_limits_the_others() -> None:
    table = study({**PAPER, "policy": ("baseline", "hover")}, truth=hover_helps_in_high_traffic)
    made = gather("Found", {}, table, {})
    differences = made.comparisons[0].differences.filter(metric="coverage", policy="hover")
    clear = differences.filter(pl.col("p_corrected") < 0.05)
    assert set(clear["traffic"]) == {"high"}
    (row,) = [
        row
        for row in rows_of(findings_section(made))
        if row[:2] == ["hover − baseline", "Coverage (percentage points)"]
    ]
    ends = [f"{100 * value:.1f}" for value in (clear["mean"].min(), clear["mean"].max())]
    rest = differences.filter(pl.col("p_corrected") >= 0.05)
    limits = [f"{100 * value:.1f}".replace("-", "−") for value in (rest["low"].min(), rest["high"].max())]
    assert row[2:4] == [f"{clear.height} of 9", " to ".join(ends)]
    assert row[5] == " to ".join(limits)


@pytest.mark.slow
def test_nothing_is_claimed_where_there_is_nothing() -> None:
    """Studies without an effect: a difference in 5 %, as far as chance allows."""
    claims = [any(row[2] != MISSING for row in found(study(seed=seed))) for seed in range(60)]
    assert sum(claims) <= stats.binom.ppf(0.999, 60, 0.05)


def test_too_few_replicates_leave_every_difference_open() -> None:
    rows = found(study({**PAPER, "policy": ("baseline", "hover")}, 5, hover_helps_in_high_traffic))
    assert {(row[2], row[5]) for row in rows} == {(MISSING, "unknown")}


def test_each_traffic_has_its_proposal() -> None:
    def helped(cell: dict[str, Any]) -> dict[str, float]:
        return {"coverage": 0.1 * ((cell["policy"] == "hover") == (cell["traffic"] == "high"))}

    study_ = gather("Per traffic", {}, study(SMALL, 12, helped), {})
    proposed = {row[0]: row[1] for row in rows_of(answer_section(study_))}
    assert proposed.keys() == {"all", "low", "high"}
    assert proposed["high"] == "hover at 6 m"
    assert proposed["low"] != "hover at 6 m"


def test_the_table_of_options_remarks_on_failures_and_limits() -> None:
    table = without(study(replicates=8), (pl.col("replicate") == 0) & (pl.col("policy") == "micro"), failed=True)
    made = gather("Options", {}, table, {}, limits=MissionLimits(max_time_s=1.0))
    section = answer_section(made)
    rows = rows_of(section, -1)
    assert [row[-1] for row in rows if row[1] == "micro"] == ["2 failed that others flew: left out"]
    assert {row[section.blocks[-1].heads.index("Keeps limits")].partition(" ")[0] for row in rows} == {"no"}
