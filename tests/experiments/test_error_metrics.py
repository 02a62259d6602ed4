"""False alarms, precision and duplicates of a study: shown where a sensor made such errors, and only there."""

from io import StringIO

import polars as pl
import pytest
from rich.console import Console

from pavetwin.cli.experiment import _options_table
from pavetwin.experiments.metrics import ERROR_METRICS, METRICS, metrics_in
from pavetwin.experiments.report.proposals import options_table
from pavetwin.experiments.report.study import Study, gather
from pavetwin.experiments.report.tables import csv, markdown
from pavetwin.experiments.statistics import MissionLimits, recommend
from scenes.report_studies import page_of
from scenes.studies import study

NAMES = {metric.name for metric in ERROR_METRICS}


def erring(false_alarms: int = 0, duplicates: int = 0) -> pl.DataFrame:
    """A study's table in which hover alone raises false alarms and duplicates, as many in every mission."""
    hover = pl.col("policy") == "hover"
    return study(replicates=6).with_columns(
        false_alarms=pl.when(hover).then(false_alarms).otherwise(0),
        duplicates=pl.when(hover).then(duplicates).otherwise(0),
        precision=pl.when(hover).then(6 / (6 + false_alarms)).otherwise(1.0),
        false_alarms_per_100_m2=pl.when(hover).then(false_alarms / 4).otherwise(0.0),
    )


def gathered(table: pl.DataFrame) -> Study:
    return gather("A study", {"seed": 0}, table, {})


@pytest.mark.parametrize(
    ("false_alarms", "duplicates", "shown"),
    [(0, 0, set()), (0, 3, {"duplicates"}), (2, 0, NAMES - {"duplicates"}), (2, 3, NAMES)],
)
def test_only_errors_that_were_made_are_shown(false_alarms: int, duplicates: int, shown: set[str]) -> None:
    table = erring(false_alarms, duplicates)
    assert {metric.name for metric in metrics_in(table)} == {metric.name for metric in METRICS} | shown
    study = gathered(table)
    assert {metric.name for metric in study.metrics} & NAMES == shown
    assert {line.split(",")[6] for line in csv(study.summary).splitlines()[1:]} & NAMES == shown
    assert {name for name in NAMES if name in recommend(table, MissionLimits()).options.columns} == shown


def test_the_reports_tables_and_definitions_hold_the_errors_of_each_policy() -> None:
    study = gathered(erring(false_alarms=2, duplicates=3))
    text = markdown(study)
    tables = {part.partition(":")[0]: part for part in text.split("**") if ": mean" in part}
    assert {"Precision (%)", "False alarms", "False alarms per 100 m²", "Duplicates"} <= set(tables)
    page = page_of(study)
    assert "<dt>Precision</dt>" in page
    assert "<dt>Duplicates</dt>" in page
    assert "what is reported wrongly" in page
    rows = [line for line in text.partition("Precision (%)")[2].splitlines() if line.startswith("| low")]
    assert "75.0" in rows[0], "6 of 8 detections of hover are right"
    assert rows[0].count("**100.0") == 2, "the best of a row is bold"


def test_the_recommendation_shows_the_errors_of_options() -> None:
    table = options_table(recommend(erring(false_alarms=2), MissionLimits()))
    columns = {head: [row[at].text for row in table.rows] for at, head in enumerate(table.heads)}
    shares = dict(zip(columns["Policy"], columns["Precision (%)"], strict=True))
    assert shares == {"baseline": "100.0", "hover": "75.0", "micro": "100.0"}
    assert sorted(columns["False alarms per 100 m²"]) == ["0.00", "0.00", "0.50"]
    assert "Duplicates" not in columns


@pytest.mark.parametrize("width", [80, 120])
def test_no_number_of_the_recommendation_is_shortened(width: int) -> None:
    chosen = recommend(erring(), MissionLimits(max_time_s=1000.0))
    console = Console(width=width, file=StringIO())
    console.print(_options_table(chosen))
    printed = console.file.getvalue()  # type: ignore[attr-defined]
    assert "…" not in printed
    for low, high in chosen.options.select("time_s_low", "time_s_high").iter_rows():
        assert f"({low:.1f}–{high:.1f})" in printed
