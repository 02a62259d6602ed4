"""The report of a study: self-contained, the same bytes twice, and true to its table."""

import re
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import polars as pl
import pytest
from matplotlib.colors import to_hex, to_rgb

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report import page as pages
from pavetwin.experiments.report.figures import overview
from pavetwin.experiments.report.page import question, write_report
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.report.tables import headline_table
from pavetwin.experiments.statistics import MissionLimits, Objective
from scenes.report_studies import (
    PAPER,
    SMALL,
    Outline,
    page_of,
    sections,
    small_study,
    study_of,
    table_of,
    with_failures,
)


@pytest.fixture(scope="module")
def small() -> str:
    return page_of(small_study(), drawn=True)


def test_every_section_is_there(small: str) -> None:
    results = {"means", "intervals", "differences", "tradeoffs", "spread"}
    front = {"overview", "flown"}
    assert sections(small) == {*results, *front, "effects", "streets", "findings", "methods", "repeat"}


def test_the_page_needs_nothing_from_elsewhere(small: str) -> None:
    outline = Outline(small)
    assert not {"script", "link", "iframe", "object", "base"} & {tag for tag, _ in outline.tags}
    assert all((image["src"] or "").startswith("data:image/") for image in outline.all("img"))
    assert all((link["href"] or "").startswith("#") for link in outline.all("a"))
    plain = unquote(small)
    namespaces = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r"https?://[^\s'\"<>)]+", plain)) <= namespaces
    assert "@import" not in plain
    assert not re.search(r"url\((?!#)", plain), "only parts of the same drawing are referred to"


def test_links_lead_to_anchors_and_anchors_are_distinct(small: str) -> None:
    outline = Outline(small)
    assert len(outline.anchors) == len(set(outline.anchors))
    assert {(link["href"] or "")[1:] for link in outline.all("a")} <= set(outline.anchors)


def test_figures_are_numbered_and_say_what_they_show(small: str) -> None:
    outline = Outline(small)
    figures = outline.all("figure")
    assert [figure["id"] for figure in figures] == [f"figure-{number}" for number in range(1, len(figures) + 1)]
    assert len(outline.all("img")) == len(figures) == small.count("<figcaption>")
    assert all(len(image["alt"] or "") > 30 for image in outline.all("img"))


def test_vector_figures_are_well_formed(small: str) -> None:
    sources = [image["src"] or "" for image in Outline(small).all("img")]
    drawings = [source for source in sources if source.startswith("data:image/svg+xml,")]
    assert len(drawings) >= 7
    for drawing in drawings:
        text = unquote(drawing.partition(",")[2])
        root = ElementTree.fromstring(text)
        names = [part.get("id") for part in root.iter() if part.get("id")]
        assert len(names) == len(set(names))
        assert set(re.findall(r"(?:href='|url\()#([\w-]+)", text)) <= set(names)


@pytest.mark.slow
def test_the_same_study_gives_the_same_bytes(tmp_path: Path) -> None:
    first = write_report(small_study(), tmp_path / "a")
    second = write_report(small_study(), tmp_path / "b")
    assert [path.name for path in first] == ["report.html", "table.csv", "table.md", "table.tex", "differences.csv"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(path.name for path in first)


def test_progress_grows_to_one(tmp_path: Path) -> None:
    reported: list[float] = []
    write_report(study_of(table_of({}, 2)), tmp_path, reported.append)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    assert max(after - before for before, after in pairwise([0.0, *reported])) <= 0.2, "a section at a time"


def test_a_folder_that_cannot_be_made_is_one_plain_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(PaveTwinError, match="Cannot write"):
        write_report(study_of(table_of({}, 1)), tmp_path / "file" / "folder")


def test_names_are_escaped() -> None:
    factors = {"policy": ("baseline", "<b>&"), "traffic": ("low", 'rush "<i>"'), "tau_o": (0.5, 0.7)}
    text = page_of(study_of(table_of(factors, 2), title="<script>alert(1)</script>"))
    outline = Outline(text)
    assert not {"script", "i"} & {tag for tag, _ in outline.tags}
    assert not any(attributes for attributes in outline.all("b"))
    assert "<b>&" in "".join(outline.words)
    assert "<script>alert(1)</script>" in "".join(outline.words)


def test_without_baseline_policies_are_compared_with_the_first() -> None:
    table = table_of({"policy": ("skip", "hover"), "altitude_m": (6.0, 10.0)}, 8)
    study = gather("No baseline", {}, table, {})
    comparison, of_altitudes = study.comparisons
    assert (comparison.factor, comparison.reference) == ("policy", "skip")
    assert (of_altitudes.factor, of_altitudes.reference) == ("altitude_m", 6.0)
    text = page_of(study)
    assert {"differences", "tradeoffs"} <= sections(text)
    assert "Paired differences to skip" in text
    assert "baseline is not among them" in text


@pytest.mark.slow
def test_a_design_may_compare_every_pair_of_policies(tmp_path: Path) -> None:
    table = table_of({"policy": ("baseline", "hover", "skip"), "traffic": ("low", "high")}, 8)
    study = gather("Pairs", {"compare": "all"}, table, {})
    write_report(study, tmp_path)
    pairs = pl.read_csv(tmp_path / "differences.csv").select("reference", "policy").unique().rows()
    assert set(pairs) == {("baseline", "hover"), ("baseline", "skip"), ("hover", "skip")}
    assert {found.number for found in study.comparisons} == {3 * 2 * 3}, "pairs of policies, densities, metrics"
    text = " ".join(page_of(study).split())
    assert "corrected for all 18 comparisons between policies in coverage, time and energy together" in text
    assert "Mean paired difference to hover" in text


def test_a_design_may_name_the_policy_that_others_are_compared_with() -> None:
    table = table_of({"policy": ("baseline", "hover", "skip")}, 8)
    (comparison,) = gather("Reference", {"compare": "hover"}, table, {}).comparisons
    assert comparison.reference == "hover"
    assert set(comparison.differences["policy"]) == {"baseline", "skip"}


def test_the_first_page_answers_the_question() -> None:
    design = {"presets": ["paper"], "sensors": ["recall"], "set": {"d_max": 4.0, "recall": 0.84}}
    study = gather("First", design, table_of(SMALL, 12), {}, limits=MissionLimits(max_time_s=60.0))
    text = page_of(study)
    front = " ".join("".join(Outline(text[text.index("<body") : text.index("<nav")] + "</main></body>").words).split())
    assert "Which altitude and policy finds most of the pavement's defects in low and high traffic with" in front
    best = study.advice[0].recommendation.best
    assert best is not None
    assert f"Fly {best['policy']} at {best['altitude_m']:g} m" in front
    assert "The proposed option in each traffic" in front
    assert "Settings that differ from the preset paper: d_max 4 (preset: 3)." in front
    assert "Figure 1." in front
    plain = page_of(gather("Plain", {**design, "set": {"recall": 0.84}}, table_of(SMALL, 3), {}))
    assert "No setting differs from the preset paper." in plain
    assert "No limit of time, battery or coverage was set" in plain


def test_the_first_page_asks_for_another_objective() -> None:
    table = table_of({"altitude_m": (6.0, 10.0), "traffic": ("low", "high")}, 3)
    study = gather("High", {}, table, {}, limits=MissionLimits(min_coverage=0.5), objective=Objective.HIGHEST)
    assert (
        question(study)
        == "Which altitude flies highest in low and high traffic with at least 50.0 % coverage a segment?"
    )
    assert {each.recommendation.objective for each in (*study.advice, *study.advice_in["low"])} == {Objective.HIGHEST}


@pytest.mark.parametrize(
    ("placing", "words"),
    [
        ("world", "Defects are those of the world."),
        ("placed", "Defects are placed in each replicate, as densely and of the classes as in the world."),
        (
            {"per_segment": 6, "mix": {"rutting": 2.0, "pothole": 1}},
            "Defects are placed in each replicate: 6 a segment, of the classes pothole 1 and rutting 2 (weights), "
            "by the damage population survey.",
        ),
        (
            {"population": "paper", "per_100_m2": 4},
            "Defects are placed in each replicate: 4 per 100 m², by the damage population paper.",
        ),
        (
            {"population": "survey"},
            "3 per 100 m² on average, varying by street and segment, by the damage population survey.",
        ),
    ],
)
def test_the_summary_of_a_study_names_its_defects_and_files(placing: object, words: str) -> None:
    design = {"defects": placing, "files": {"/home/me/rutting.py": "3f9c2a81"}}
    summary = pages.design_words(study_of(table_of(SMALL, 1), **design))
    assert words in summary
    assert "Files of your own, with the beginning of their SHA-256: rutting.py (3f9c2a81)." in summary
    assert "Files of your own" not in pages.design_words(study_of(table_of(SMALL, 1), defects=placing))


def test_marks_of_the_first_figure_differ_in_grey() -> None:
    """Shapes distinguish policies, and fillings of falling lightness altitudes."""
    (group,) = study_of(table_of(PAPER, 6)).groups()
    figure = overview(group, metric_named("coverage"), metric_named("time_s"), group.traffics)
    marks = [line for line in figure.axes[0].lines if line.get_marker() not in (None, "None", "")]
    looks_of = {(line.get_marker(), to_hex(line.get_markerfacecolor())) for line in marks}
    assert len(marks) == len(looks_of) == 12
    for marker in {line.get_marker() for line in marks}:
        greys = [sum(to_rgb(line.get_markerfacecolor())) for line in marks if line.get_marker() == marker]
        assert greys == sorted(greys, reverse=True)
        assert min(one - other for one, other in pairwise(greys)) > 0.3


def test_swept_values_are_compared_with_the_preset_s_own_or_the_first() -> None:
    factors = {"policy": ("baseline", "hover"), "tau_o": (0.5, 0.7, 0.9), "recall": (0.5, 0.6)}
    design = {"presets": ["paper"], "sweep": {"tau_o": [0.5, 0.7, 0.9], "recall": [0.5, 0.6]}}
    study = gather("Swept", design, table_of(factors, 3), {})
    assert [(found.factor, found.reference) for found in study.comparisons] == [
        ("policy", "baseline"), ("tau_o", 0.7), ("recall", 0.5),
    ]  # fmt: skip
    assert study.usual == {"tau_o": 0.7, "recall": 0.5}
    assert "Compared with tau_o = 0.7: as the preset has it." in page_of(study)
    assert "Over tau_o" in page_of(study)


@pytest.mark.slow
def test_sentences_figures_and_files_tell_the_same_differences(tmp_path: Path) -> None:
    """Figures, text and files all use the corrected test."""
    table = table_of({**SMALL, "policy": ("baseline", "hover", "micro", "skip")}, 12)
    study = gather("One source", {}, table, {})
    reported = study.comparisons[0].differences.with_columns(
        clear=pl.col("p_corrected") < 0.05, off=(pl.col("low") > 0) | (pl.col("high") < 0)
    )
    assert reported["clear"].to_list() == reported["off"].to_list()
    assert 0 < reported["clear"].sum() < (reported["p"] < 0.05).sum()
    write_report(study, tmp_path)
    written = pl.read_csv(tmp_path / "differences.csv").filter(factor="policy")
    assert written["low"].to_list() == pytest.approx(reported["low"].to_list())


@pytest.mark.parametrize("varied", ["traffic", "altitude_m", "policy"])
def test_one_level_of_the_others_is_enough(varied: str) -> None:
    text = page_of(study_of(table_of({varied: SMALL[varied]}, 3)))
    assert {"means", "intervals", "spread"} <= sections(text)
    assert ("differences" in sections(text)) == (varied == "policy")


def test_a_single_cell_flown_once() -> None:
    text = page_of(study_of(table_of({}, 1)))
    assert {"means", "spread", "methods", "repeat"} <= sections(text)
    assert "overview" not in sections(text)
    assert not {"differences", "tradeoffs", "effects", "across", "failures", "streets"} & sections(text)


def test_failures_are_listed_with_their_reasons() -> None:
    text = page_of(study_of(with_failures(table_of(SMALL, 4), 9, "no route to <segment>")))
    assert "failures" in sections(text)
    assert "no route to &lt;segment&gt;" in text
    assert "6 of 48 missions failed" in text


def test_statistics_need_no_columns_of_what_does_not_vary() -> None:
    table = table_of({"altitude_m": (6.0, 10.0)}, 3)
    assert page_of(study_of(table, sparse=True)) == page_of(study_of(table))


def test_all_missions_failed() -> None:
    text = page_of(study_of(with_failures(table_of(SMALL, 2), 1)))
    assert "failures" in sections(text)
    assert not {"means", "intervals", "spread", "tradeoffs"} & sections(text)


def test_other_factors_have_a_section_for_each_combination() -> None:
    study = study_of(table_of({"policy": ("baseline", "own"), "world": ("a", "b"), "sensor": ("ideal", "recall")}, 2))
    text = page_of(study)
    found = sections(text)
    assert {"across", *(f"results-{at}" for at in range(1, 5)), "results-4-means"} <= found
    assert "Results: world a, sensor ideal" in text
    assert len(list(study.groups())) == 4


def test_a_sweep_is_one_section_and_rows_of_the_same_tables() -> None:
    """Plots have its values from left to right; all else is drawn at the one that the others are compared with."""
    study = study_of(table_of({"policy": ("baseline", "own"), "tau_o": (0.5, 0.7, 0.9), "altitude_m": (6.0, 10.0)}, 6))
    text = page_of(study)
    results = {"means", "over-1", "intervals", "differences", "tradeoffs", "spread"}
    assert results <= sections(text)
    assert not any(anchor.startswith("results") for anchor in sections(text))
    (group,) = study.groups()
    table = headline_table(group, metric_named("coverage"))
    assert table.heads == ("Traffic", "Altitude", "tau_o", "baseline", "own")
    assert [row[2].text for row in table.rows] == ["0.5", "0.7", "0.9"] * 2
    for row in table.rows:
        cell = group.at({"tau_o": float(row[2].text)}).cell("coverage", "low", float(row[1].text[:-2]), "own")
        assert cell is not None
        assert row[4].text.startswith(f"{100 * cell['mean']:.1f} ±")
    assert "Coverage over tau_o: means" in text
    assert "Mean paired difference to tau_o = 0.5" in text
    assert "(tau_o 0.5)" in text
    assert "(tau_o 0.7)" not in text


def test_many_combinations_are_cut_short_with_a_note() -> None:
    text = page_of(study_of(table_of({"world": tuple(f"town {at}" for at in range(1, 19))}, 2)))
    found = sections(text)
    assert "results-4-intervals" in found
    assert "results-5-intervals" not in found
    assert "results-16-means" in found
    assert "results-17" not in found
    assert "2 more combinations" in text


def test_a_swept_truth_value_is_read_in_words() -> None:
    text = page_of(study_of(table_of({"policy": ("baseline", "hover"), "slow": (False, True)}, 2)))
    assert ">slow</th>" in text
    assert ">yes</th>" in text


def test_shares_of_defects_say_how_many_they_rest_on() -> None:
    """Each of 4 replicates has 10 defects, of which the camera passed 9."""
    study = study_of(table_of(SMALL, 4))
    (group,) = study.groups()
    for name, number in (("coverage", "40"), ("recovery", "36")):
        assert f"Each mean rests on {number} defects." in headline_table(group, metric_named(name)).notes
    assert not any("rests on" in note for note in headline_table(group, metric_named("time_s")).notes)
    text = page_of(study)
    assert "Each coverage rests on 40 defects." in text
    assert "with 95 % intervals; each coverage rests on 40 defects." in text


@pytest.mark.parametrize(("replicates", "warned"), [(10, True), (20, False)])
def test_few_replicates_warn_of_differences_that_depend_on_waiting(replicates: int, warned: bool) -> None:
    text = page_of(study_of(table_of({**SMALL, "altitude_m": (6.0,)}, replicates)))
    assert ("Differences in time and energy that depend on waiting (hover)" in text) is warned
    dry = table_of({"policy": ("baseline", "skip")}, replicates)
    assert "depend on waiting" not in page_of(study_of(dry))


def test_energy_proportional_to_time_has_a_note() -> None:
    table = table_of(SMALL, 4)
    (other,) = study_of(table).groups()
    (group,) = study_of(table.with_columns(energy=pl.col("time_s") / 1800)).groups()
    note = "The battery falls evenly with time here: energy in % is time in s over 18."
    assert note in headline_table(group, metric_named("energy")).notes
    assert note not in headline_table(group, metric_named("time_s")).notes
    assert note not in headline_table(other, metric_named("energy")).notes
