"""The tables of a study's report: bold cells, dashes, and files that agree with the summary."""

import re
from dataclasses import replace
from io import StringIO

import polars as pl
import pytest

from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report.study import Group, Study
from pavetwin.experiments.report.tables import csv, escape, headline_table, latex, latex_table, markdown, tail_table
from pavetwin.reports.blocks import Table
from scenes.report_studies import PAPER, SMALL, study_of, table_of, with_failures
from scenes.studies import without


def only_group(study: Study) -> Group:
    (group,) = study.groups()
    return group


def with_means(means: dict[str, float | None], metric: str) -> Table:
    """The headline table of one row of cells with these means, a policy each."""
    study = study_of(table_of({"policy": tuple(means)}, 3))
    chosen = pl.col("metric") == metric
    given = pl.col("policy").replace_strict(means, return_dtype=pl.Float64)
    summary = study.summary.with_columns(pl.when(chosen).then(given).otherwise("mean").alias("mean"))
    return headline_table(only_group(replace(study, summary=summary)), metric_named(metric))


def bold(table: Table) -> set[str]:
    return {head for row in table.rows for head, cell in zip(table.heads, row, strict=True) if cell.strong}


@pytest.mark.parametrize(
    ("metric", "means", "best"),
    [
        ("coverage", {"baseline": 0.5, "hover": 0.7, "skip": 0.6}, {"hover"}),
        ("time_s", {"baseline": 40.0, "hover": 70.0, "skip": 50.0}, {"baseline"}),
        ("energy", {"baseline": 0.04, "hover": 0.03, "skip": None}, {"hover"}),
        ("coverage", {"baseline": 0.5, "hover": 0.70004, "skip": 0.69996}, {"hover", "skip"}),
        ("coverage", {"baseline": 0.5, "hover": 0.5, "skip": 0.5}, set()),
        ("coverage", {"baseline": None, "hover": 0.0, "skip": 0.2}, {"skip"}),
        ("distance_m", {"baseline": 1.0, "hover": 2.0, "skip": 3.0}, set()),
        ("coverage", {"hover": 0.5}, set()),
    ],
)
def test_the_best_of_a_row_is_bold(metric: str, means: dict[str, float | None], best: set[str]) -> None:
    assert bold(with_means(means, metric)) == best


def test_the_mean_of_what_failed_alone_is_never_bold() -> None:
    """It leaves out what the others flew; what failed for all alike leaves the means comparable."""
    table = table_of({"policy": ("baseline", "hover", "skip"), "tau_o": (0.5, 0.7)}, 4)
    shares = {"baseline": 0.5, "hover": 0.9, "skip": 0.7}
    table = table.with_columns(coverage=pl.col("policy").replace_strict(shares))
    hard = (pl.col("replicate") == 0) & (pl.col("tau_o") == 0.5)

    def drawn(failed: pl.Expr) -> tuple[list[set[str]], bool]:
        grid = headline_table(only_group(study_of(without(table, failed, failed=True))), metric_named("coverage"))
        strong = [{head for head, cell in zip(grid.heads, row, strict=True) if cell.strong} for row in grid.rows]
        return strong, any("another option flew is never bold" in note for note in grid.notes)

    assert drawn(hard & (pl.col("policy") == "hover")) == ([{"skip"}, {"hover"}], True)
    assert drawn(hard & (pl.col("policy") != "skip")) == ([set(), {"hover"}], True)
    assert drawn(hard) == ([{"hover"}, {"hover"}], False)


def test_undefined_is_a_dash_and_never_a_number() -> None:
    table = with_means({"baseline": None, "hover": 0.5}, "coverage")
    assert table.rows[0][2].text == "—"
    assert any("no defined value" in note for note in table.notes)


def test_density_and_altitude_go_down_and_policies_across() -> None:
    table = headline_table(only_group(study_of(table_of(PAPER, 2))), metric_named("coverage"))
    assert table.heads == ("Traffic", "Altitude", "baseline", "hover", "micro", "skip")
    lead = [(row[0].text, row[1].text.replace("\u00a0", " ")) for row in table.rows]
    assert lead == [(t, h) for t in ("low", "medium", "high") for h in ("6 m", "10 m", "15 m")]
    assert [table.height(at, 0) for at in range(9)] == [3, 0, 0] * 3


def test_levels_keep_their_order_whatever_the_order_of_rows() -> None:
    table = table_of(PAPER, 2)
    study = study_of(table.reverse(), policies=["skip", "baseline", "hover", "micro"])
    group = only_group(study)
    assert group.traffics == ["low", "medium", "high"]
    assert group.altitudes == [6.0, 10.0, 15.0]
    assert group.policies == ["skip", "baseline", "hover", "micro"]


def test_missions_without_a_value_are_counted() -> None:
    table = table_of(SMALL, 4)
    first = (pl.col("replicate") == 0) & (pl.col("policy") == "hover") & (pl.col("altitude_m") == 6.0)
    gone = pl.when(first).then(None).otherwise("coverage").alias("coverage")
    grid = headline_table(only_group(study_of(with_failures(table.with_columns(gone), 24))), metric_named("coverage"))
    notes = " ".join(grid.notes)
    assert "n = 4" in notes
    assert "2 missions without a defined value" in notes
    assert "2 missions failed" in notes
    defined = [int(cell.aside.strip(" ()")) for row in grid.rows for cell in row if cell.aside]
    assert sum(4 - n for n in defined) == 4


def test_cells_with_too_few_values_are_marked() -> None:
    table = table_of({"policy": ("baseline", "hover")}, 8)
    gone = (pl.col("replicate") > 3) & (pl.col("policy") == "hover")
    table = table.with_columns(pl.when(gone).then(None).otherwise("coverage").alias("coverage"))
    grid = headline_table(only_group(study_of(table)), metric_named("coverage"))
    assert [cell.aside for cell in grid.rows[0][2:]] == ["", " (4†)"]
    assert "†: too few for the certainty of the mean." in grid.notes
    assert r"(4\dag{})" in latex_table(grid, "tab:x")
    every = headline_table(only_group(study_of(table_of({}, 3))), metric_named("coverage"))
    assert "These are too few for the certainty of a mean." in every.notes


def test_one_replicate_has_no_spread() -> None:
    grid = headline_table(only_group(study_of(table_of(SMALL, 1))), metric_named("time_s"))
    assert not any("±" in cell.text for row in grid.rows for cell in row)


def test_tails_are_median_percentile_and_maximum() -> None:
    study = study_of(table_of(SMALL, 5))
    grid = tail_table(only_group(study), metric_named("time_s"))
    row = study.summary.filter(pl.col("metric") == "time_s").row(0, named=True)
    assert grid.rows[0][2].text == " / ".join(f"{row[name]:.1f}" for name in ("median", "p95", "maximum"))


def test_the_csv_reads_back_to_the_summary() -> None:
    summary = study_of(with_failures(table_of({**SMALL, "tau_o": (0.5, 0.7)}, 3), 7)).summary
    back = pl.read_csv(StringIO(csv(summary)), schema=summary.schema)
    assert back.equals(summary)


def test_markdown_is_a_table_for_github() -> None:
    text = markdown(study_of(table_of({"policy": ("baseline", "my|own*", "<b>")}, 2)))
    lines = [line for line in text.splitlines() if line.startswith("|")]
    pipes = {len(re.findall(r"(?<!\\)\|", line)) for line in lines}
    assert pipes == {6}
    assert r"my\|own\*" in text
    assert r"\<b\>" in text
    assert "**" in lines[2]


def test_latex_compiles_by_its_structure() -> None:
    study = study_of(table_of({**SMALL, "policy": ("baseline", "my_own 100%", "a&b{c}\\d")}, 3), title="A\nnew % line")
    text = latex(study)
    code = re.sub(r"\\.", "", re.sub(r"(?<!\\)%.*", "", text))
    assert code.count("{") == code.count("}")
    for kind in ("table", "tabular"):
        assert text.count(rf"\begin{{{kind}}}") == text.count(rf"\end{{{kind}}}") == 5
    assert text.count(r"\toprule") == text.count(r"\midrule") == text.count(r"\bottomrule") == 5
    assert r"my\_own 100\%" in text
    assert r"a\&b\{c\}\textbackslash{}d" in text
    assert r"\textbf{" in text
    assert r"$\pm$" in text
    assert "±" not in text
    columns = {len(re.findall(r"(?<!\\)&", line)) for line in text.splitlines() if line.endswith(r"\\")}
    assert columns == {2, 4}, "the heads over the policies, and rows"
    assert all(line.startswith("%") for line in text.splitlines()[:2])


def test_latex_labels_are_distinct() -> None:
    labels = re.findall(r"\\label\{(.*?)\}", latex(study_of(table_of({**SMALL, "world": ("a", "b", "c")}, 2))))
    assert len(labels) == len(set(labels)) == 15


def test_latex_keeps_what_it_can_set() -> None:
    assert escape("~^<>|") == r"\textasciitilde{}\textasciicircum{}\textless{}\textgreater{}\textbar{}"
    assert escape("6\u00a0m − 2") == "6~m $-$ 2"


def test_latex_of_one_policy_spans_nothing() -> None:
    table = headline_table(only_group(study_of(table_of({"altitude_m": (6.0, 10.0)}, 2))), metric_named("coverage"))
    assert r"\multicolumn" not in latex_table(table, "tab:x")
