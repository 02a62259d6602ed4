"""The condition index by what was detected, as a metric of studies and as what an option is chosen by."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import polars as pl
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.advice import advise
from pavetwin.experiments.metrics import DETECTED, INDEX_ERROR, METRICS, has_detected, metrics_in
from pavetwin.experiments.report.proposals import options_table
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.report.tables import csv, markdown
from pavetwin.experiments.statistics import MissionLimits, Objective, recommend
from pavetwin.experiments.statistics.summary import summarise
from pavetwin.experiments.tours import MISSION_COLUMNS, by_mission
from scenes.report_studies import page_of
from scenes.studies import PAPER, study

LEVELS = {**PAPER, "traffic": ("low",), "altitude_m": (6.0, 10.0, 15.0), "policy": ("baseline",)}
ERRORS: Mapping[float, tuple[float, float]] = {6.0: (20.0, -20.0), 10.0: (-4.0, -6.0), 15.0: (9.0, 9.0)}
"""By altitude, of even and of odd replicates. From 6 m they cancel each other out; no street has the right index."""

SOME = MissionLimits(min_coverage=0.05)


def measured(table: pl.DataFrame) -> pl.DataFrame:
    """A study's table with these errors of the index by what was detected."""
    odd = pl.col("replicate") % 2
    sides = [
        pl.col("altitude_m").replace_strict({altitude: error[side] for altitude, error in ERRORS.items()})
        for side in (0, 1)
    ]
    error = pl.when(odd == 1).then(sides[1]).otherwise(sides[0])
    return table.with_columns(pci=pl.lit(60.0), pci_detected=60.0 + error, pci_detected_error=error).with_columns(
        pl.col("pci_detected_error").abs().alias(INDEX_ERROR)
    )


@pytest.fixture(scope="module")
def table() -> pl.DataFrame:
    return measured(study(LEVELS, 12, seed=2))


def test_the_most_accurate_index_is_that_of_the_least_error_not_of_the_least_mean_error(table: pl.DataFrame) -> None:
    made = recommend(table, SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert made.options["altitude_m"].to_list() == [10.0, 15.0, 6.0]
    assert made.options[INDEX_ERROR].to_list() == pytest.approx([5.0, 9.0, 20.0])
    assert made.best is not None
    assert made.best["certainty"] > 0.95
    assert made.best[f"{INDEX_ERROR}_expected"] == pytest.approx(5.0, abs=1.0)
    assert made.lead() == "4.0 points"


def test_limits_hold_for_the_most_accurate_index_too(table: pl.DataFrame) -> None:
    slower = table.with_columns(time_s=pl.when(pl.col("altitude_m") == 10).then(500.0).otherwise(pl.col("time_s")))
    made = recommend(
        slower, MissionLimits(max_time_s=300.0, min_coverage=0.05), objective=Objective.MOST_ACCURATE_INDEX
    )
    assert made.best is not None
    assert made.best["altitude_m"] == 15.0


def only(table: pl.DataFrame, measured: pl.Expr) -> pl.DataFrame:
    """The table with an index by what was detected in these missions alone."""
    return table.with_columns(pl.when(measured).then(pl.col(name)).alias(name) for name in DETECTED)


def test_replicates_are_those_with_an_index_and_not_those_with_a_coverage(table: pl.DataFrame) -> None:
    one = only(table.with_columns(defects=pl.lit(10)), pl.col("replicate") == 0)
    made = recommend(one, SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert made.options["replicates"].to_list() == [1, 1, 1]
    assert made.options["certainty"].null_count() == made.options["kept"].null_count() == 3
    assert made.options["coverage_replicates"].to_list() == [12, 12, 12]


@pytest.mark.parametrize("replicates", [0, 1, 4])
def test_an_option_with_too_few_indices_is_left_out(table: pl.DataFrame, replicates: int) -> None:
    few = (pl.col("altitude_m") != 10) | (pl.col("replicate") < replicates)
    made = recommend(only(table, few), SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert made.best is not None
    assert made.best["altitude_m"] == 15.0
    assert made.best["certainty"] > 0.95
    left = made.options.row(by_predicate=pl.col("altitude_m") == 10.0, named=True)
    assert (left["feasible"], left["kept"], left["certainty"], left["replicates"]) == (False, None, None, replicates)
    assert f"index measured in {replicates} replicates: left out" in options_table(made).rows[-1][-1].text
    limits = MissionLimits(min_coverage=0.99)
    refused = recommend(only(table, few), limits, objective=Objective.MOST_ACCURATE_INDEX)
    assert refused.nearest is not None
    assert refused.nearest["altitude_m"] != 10.0


def test_an_option_with_enough_indices_takes_part_and_the_fewest_are_counted(table: pl.DataFrame) -> None:
    some = only(table, (pl.col("altitude_m") != 15) | (pl.col("replicate") < 8))
    made = recommend(some, SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert made.options["altitude_m"].to_list() == [10.0, 15.0, 6.0]
    assert made.options["feasible"].all()
    assert made.options["replicates"].to_list() == [12, 8, 12]


def test_an_option_that_finds_nothing_is_not_the_most_accurate(table: pl.DataFrame) -> None:
    """It reports an index of 100, which errs by little over sound roads."""
    nothing, names = pl.col("altitude_m") == 15, ("coverage", *DETECTED)
    values = dict(zip(names, (0.0, 100.0, 2.0, 2.0), strict=True))
    sound = table.with_columns(
        pl.when(nothing).then(pl.lit(value)).otherwise(pl.col(name)).alias(name) for name, value in values.items()
    )
    for limits in (MissionLimits(), MissionLimits(max_time_s=300.0)):
        with pytest.raises(PaveTwinError, match=r"^`objective` most-accurate-index: without a least coverage"):
            recommend(sound, limits, objective=Objective.MOST_ACCURATE_INDEX)
    made = recommend(sound, SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert made.best is not None
    assert made.best["altitude_m"] == 10.0


def test_the_error_has_a_sign_in_the_summary_and_none_in_what_options_are_judged_by(table: pl.DataFrame) -> None:
    known = summarise(table, ["altitude_m"], metrics_in(table)).filter(altitude_m=10.0)
    (signed,), (size,) = (known.filter(metric=name).to_dicts() for name in DETECTED[1:])
    assert (signed["mean"], size["mean"]) == (pytest.approx(-5.0), pytest.approx(5.0))
    assert signed["low"] < -5.0 < signed["high"] < 0.0, "its interval is not cut at 0"


def test_the_report_shows_the_index_where_it_was_measured(table: pl.DataFrame) -> None:
    made = gather("A study", {"seed": 0}, table, {})
    assert {line.split(",")[6] for line in csv(made.summary).splitlines()[1:]} >= set(DETECTED[1:])
    tables = {part.partition(":")[0]: part for part in markdown(made).split("**") if ": mean" in part}
    assert {"Index as detected less true (points)", "Index error as detected (points)"} <= set(tables)
    page = page_of(made)
    assert "<dt>Index error as detected</dt>" in page
    assert "(accuracy of the index)" in page
    bare = gather("A study", {"seed": 0}, study(LEVELS, 6), {})
    for text in (page_of(bare), markdown(bare), csv(bare.summary)):
        assert "as detected" not in text
        assert "pci_detected" not in text


def test_the_least_error_of_a_row_is_bold_and_a_sign_is_never() -> None:
    levels = {**LEVELS, "altitude_m": (10.0,), "policy": ("baseline", "hover")}
    both = measured(study(levels, 6)).with_columns(
        pl.when(pl.col("policy") == "hover").then(pl.col(name) / 2).otherwise(pl.col(name)).alias(name)
        for name in DETECTED[1:]
    )
    parts = markdown(gather("A study", {"seed": 0}, both, {})).split("\n\n")
    signed, size = (
        next(rows for head, rows in pairwise(parts) if head.startswith(f"**{label}"))
        for label in ("Index as detected less true", "Index error as detected")
    )
    assert "**2.5" in size
    assert "**5.0" not in size
    assert "**" not in signed


def test_a_sensor_without_sizes_has_no_recommendation_by_the_index() -> None:
    levels = {**LEVELS, "sensor": ("recall", "detector")}
    both = measured(study(levels, 6)).with_columns(
        pl.when(pl.col("sensor") == "detector").then(pl.col(name)).alias(name) for name in DETECTED
    )
    recall, detector = advise(both, SOME, objective=Objective.MOST_ACCURATE_INDEX)
    assert recall.recommendation.best is None
    assert not recall.recommendation.is_measured
    assert recall.sentences[0].startswith("No mission has a condition index of its detections")
    assert detector.recommendation.best is not None
    assert detector.recommendation.best["altitude_m"] == 10.0
    heads = [options_table(each.recommendation).heads for each in advise(both, MissionLimits())]
    assert ["Index error as detected (points)" in head for head in heads] == [False, True]


def test_a_study_without_measured_sizes_has_no_such_index() -> None:
    old = study(LEVELS, 6)
    assert {metric.name for metric in metrics_in(old)} == {metric.name for metric in METRICS}
    assert recommend(old, MissionLimits()).best is not None
    with pytest.raises(
        PaveTwinError, match=r"^`objective` most-accurate-index: no mission has a condition index of its detections"
    ):
        advise(old, SOME, objective=Objective.MOST_ACCURATE_INDEX)


def tour(errors: Sequence[float | None], sensor: str = "detector", replicate: int = 0) -> list[dict[str, Any]]:
    """The rows of a mission over segments of 100, 300, … m² whose index is detected with these errors."""
    row: dict[str, Any] = {"world": "w", "traffic": "low", "altitude_m": 6.0, "policy": "hover", "sensor": sensor}
    row |= {"preset": "default", "replicate": replicate, "status": "flown", "reason": None}
    sums = ("length_m", "defects", "swept", "confirmed", "recovered", "wait_s", "occlusions", "revisits", "duplicates")
    rest = dict.fromkeys((*sums, "false_alarms"), 1.0) | dict.fromkeys(("surface_coverage", "coverage", "energy"), 0.5)
    rest |= {"permanently_hidden": 0.0, "pci": 50.0, "time_s": 60.0}
    whole: dict[str, Any] = dict.fromkeys(MISSION_COLUMNS, 1.0) | {"mission_batteries": 1}
    return [
        row
        | {"order": order, "area_m2": 100.0 + 200.0 * order}
        | rest
        | dict(zip(DETECTED, (None,) * 3 if off is None else (50.0 + off, off, abs(off)), strict=True))
        | whole
        for order, off in enumerate(errors)
    ]


def missions_of(*rows: Sequence[dict[str, Any]]) -> pl.DataFrame:
    types = {"reason": pl.String, **dict.fromkeys(DETECTED, pl.Float64)}
    return by_mission(pl.DataFrame([each for mission in rows for each in mission], schema_overrides=types))


def test_of_tours_the_errors_of_streets_do_not_cancel_each_other_out() -> None:
    """A mission over two segments of 100 and 300 m², ten points too high and ten too low."""
    (mission,) = missions_of(tour([10.0, -10.0])).to_dicts()
    assert [mission[name] for name in DETECTED] == pytest.approx([45.0, -5.0, 10.0])


@pytest.mark.parametrize("errors", [[None, None], [10.0, None]])
def test_a_tour_has_no_index_where_a_street_has_none(errors: list[float | None]) -> None:
    missions = missions_of(tour(errors))
    assert [*missions.select(DETECTED).row(0)] == [None] * 3
    assert missions["pci"].to_list() == [50.0]
    assert not has_detected(missions)
