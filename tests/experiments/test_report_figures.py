"""The figures and maps of the report of a study."""

import re
from itertools import pairwise, product
from pathlib import Path
from xml.etree import ElementTree

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pavetwin.draw import style
from pavetwin.draw.style import POLICY_COLOURS, policy_styles
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.report.figures import (
    by_altitude,
    on_front,
    options,
    policy_legend,
    spread,
    tradeoff,
)
from pavetwin.experiments.report.page import write_report
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.report.study_sections import colour_range, street_map, street_means
from pavetwin.experiments.statistics.summary import summarise
from pavetwin.reports.canvas import slim
from scenes import tiny
from scenes.report_studies import PAPER, SMALL, page_of, sections, small_study, study_of, table_of
from scenes.studies import without


def test_what_failed_alone_is_not_on_the_front() -> None:
    """Its means leave out what the others flew; what failed for all alike leaves the means comparable."""
    table = table_of(SMALL, 4)
    (group,) = study_of(table).groups()
    metrics = metric_named("coverage"), metric_named("time_s")
    cheapest = min(options(group, "high", *metrics), key=lambda option: float(option.cost["mean"]))
    assert cheapest.on_front
    high = (pl.col("traffic") == "high") & (pl.col("replicate") == 0)
    alone = high & (pl.col("policy") == cheapest.policy) & (pl.col("altitude_m") == cheapest.altitude_m)
    study = study_of(without(table, alone, failed=True))
    (group,) = study.groups()
    fronts = {
        traffic: {(o.altitude_m, o.policy) for o in options(group, traffic, *metrics) if o.on_front}
        for traffic in group.traffics
    }
    option = (cheapest.altitude_m, cheapest.policy)
    assert option not in fronts["high"]
    assert option in fronts["low"]
    words = f"leave them out: {cheapest.policy} at {cheapest.altitude_m:g}\u00a0m (1 failed)."
    assert words in page_of(study)
    assert "leave them out" not in page_of(study_of(without(table, high, failed=True)))


@pytest.mark.parametrize("policies", [4, pytest.param(14, marks=pytest.mark.slow)])
def test_words_of_logarithmic_axes_stand_clear_of_each_other(policies: int) -> None:
    """Time and energy with heavy tails in three narrow panels."""
    own = tuple(f"own {number}" for number in range(policies - 4))
    (group,) = study_of(table_of({**PAPER, "policy": ("baseline", "hover", "micro", "skip", *own)}, 20)).groups()
    coverage, time, energy = (metric_named(name) for name in ("coverage", "time_s", "energy"))
    figures = [tradeoff(group, coverage, cost, group.traffics) for cost in (time, energy)]
    figures += [spread(group, metric, group.traffics) for metric in (time, energy)]
    for figure, dpi in product(figures, (72, 200)):
        figure.set_dpi(dpi)  # an SVG is laid out in points
        figure.draw_without_rendering()
        for axes in figure.axes:
            low, high = axes.get_xlim()
            found = [axis for axis in axes.get_xticklabels() if low <= axis.get_position()[0] <= high]
            boxes = sorted((label.get_window_extent() for label in found), key=lambda box: box.x0)
            assert len(boxes) >= 3
            assert all(one.x1 < other.x0 for one, other in pairwise(boxes))


def test_every_logarithmic_axis_is_labelled_so() -> None:
    (group,) = study_of(table_of(PAPER, 20)).groups()
    coverage, time, wait = (metric_named(name) for name in ("coverage", "time_s", "wait_s"))
    figures = [tradeoff(group, coverage, time, group.traffics), spread(group, time, group.traffics)]
    figures += [spread(group, coverage, group.traffics), by_altitude(group, [coverage, time, wait], group.traffics)]
    scales = {
        (getattr(axes, f"get_{axis.axis_name}scale")(), "(log scale)" in axis.get_label_text())
        for figure in figures
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        if axis.get_label_text()
    }
    assert scales == {("log", True), ("linear", False)}


def test_whiskers_end_at_the_percentiles_of_the_tables() -> None:
    """Not at the last mission within them."""
    table = table_of(PAPER, 20)
    (group,) = study_of(table).groups()
    time = metric_named("time_s")
    numbers = summarise(table, ["traffic", "altitude_m", "policy"], [time])
    figure = spread(group, time, group.traffics)
    for traffic, axes in zip(group.traffics, figure.axes, strict=True):
        whiskers = [line for line in axes.lines if len(line.get_xdata()) == 2 and len(set(line.get_ydata())) == 1]
        drawn = sorted(line.get_xdata()[1] for line in whiskers)
        cells = table.filter(traffic=traffic).group_by("altitude_m", "policy")
        low = cells.agg(pl.col("time_s").quantile(0.05, "linear"))["time_s"]
        assert drawn == pytest.approx(sorted([*low, *numbers.filter(traffic=traffic)["p95"]]))


def test_fourteen_policies_have_distinct_styles() -> None:
    chosen = policy_styles([*POLICY_COLOURS, *(f"own {number}" for number in range(10))])
    assert len({look.colour for look in chosen.values()}) == len({look.marker for look in chosen.values()}) == 14
    assert len({look.dash for look in chosen.values()}) == 3
    assert chosen["hover"] == policy_styles(["own", "hover"])["hover"]


def test_streets_are_means_over_their_missions() -> None:
    table = table_of({"policy": ("baseline", "hover")}, 6)
    nothing = pl.when(pl.col("replicate") == 1).then(None).otherwise("coverage").alias("coverage")
    means = street_means(table.with_columns(nothing), "tiny")
    side = means.filter(pl.col("segment") == "side").row(0, named=True)
    of_side = table.filter(pl.col("segment") == "side", pl.col("replicate") == 4)
    assert (side["missions"], side["replicates"]) == (2, 1)
    assert side["coverage"] == pytest.approx(of_side["coverage"].mean())
    assert means["coverage"].is_sorted()


def test_segments_without_defects_are_counted_and_have_no_coverage() -> None:
    table = table_of({"policy": ("baseline", "hover")}, 3)
    worlds = {"tiny": tiny.bent()}
    full = page_of(study_of(table, worlds=worlds))
    assert "had no defects to find" not in full
    assert "is little evidence" not in full
    assert "A coverage of fewer than 10 defects is little evidence" in page_of(
        study_of(table.with_columns(defects=pl.lit(4, pl.Int64)), worlds=worlds)
    )
    on_side = pl.col("segment") == "side"
    empty = [pl.when(on_side).then(None).otherwise(name).alias(name) for name in ("coverage", "swath_coverage")]
    text = page_of(
        study_of(table.with_columns(*empty, defects=pl.when(on_side).then(0).otherwise("defects")), worlds=worlds)
    )
    assert "1 more segment flown had no defects to find in any replicate, and no coverage." in text
    assert "side road" not in text.split("Street by street")[1].split("</table>")[0]


def test_a_map_shows_the_segments_that_were_flown() -> None:
    means = street_means(table_of(SMALL, 3), "tiny")
    picture = street_map(tiny.bent(), means)
    assert picture is not None
    assert picture.source.startswith("data:image/png;base64,")
    assert "2 segments" in picture.alt, "the third of the table is in no tiny world"
    assert street_map(tiny.straight(), means.filter(pl.col("segment") == "side")) is None


@pytest.mark.parametrize(
    ("values", "ends"),
    [((100.0, 100.0), (90, 100)), ((0.0, 0.0), (0, 10)), ((83.0, 88.0), (80, 90)), ((41.0, 100.0), (40, 100))],
)
def test_the_colours_of_a_map_span_tens_that_coverage_can_have(
    values: tuple[float, float], ends: tuple[float, float]
) -> None:
    norm = colour_range(values)
    assert (norm.vmin, norm.vmax) == ends


def test_gathered_statistics_fit_the_report() -> None:
    made_with = {"SUMO": "1.2.3", "world tiny": "0123abcd"}
    study = gather("Gathered", {"seed": 3, "version": "0.0.0", "made_with": made_with}, table_of(SMALL, 5), {})
    assert study.factors == ("traffic", "altitude_m", "policy")
    assert study.others == ()
    text = page_of(study)
    assert {"means", "differences", "effects", "findings"} <= sections(text)
    assert "version:" not in text, "it is not a key of a design"
    assert "made_with" not in text
    assert "PaveTwin\n0.0.0, SUMO 1.2.3, world tiny 0123abcd" in text


@pytest.mark.slow
def test_figures_are_files_too_when_they_are_asked_for(tmp_path: Path) -> None:
    study = small_study()
    plain = write_report(study, tmp_path / "plain")
    written = write_report(study, tmp_path / "all", figures=True)
    figures = [path for path in written if path.parent.name == "figures"]
    text = (tmp_path / "all" / "report.html").read_text()
    assert len(figures) == text.count("<img ") == len(written) - len(plain) > 5
    for path in figures:
        if path.suffix == ".svg":
            assert ElementTree.fromstring(path.read_text()).tag.endswith("svg")
        else:
            assert path.read_bytes().startswith(b"\x89PNG")


_GLYPH_SCALE = re.compile(r"scale\(([^)]*)\)")


def test_a_slimmed_figure_keeps_the_size_of_its_letters(tmp_path: Path) -> None:
    figure = Figure(figsize=(3, 1))
    figure.text(0.1, 0.5, "Low traffic", fontsize=7.5)
    figure.savefig(tmp_path / "figure.svg")
    svg = (tmp_path / "figure.svg").read_text(encoding="utf-8")
    slimmed = slim(svg)
    assert len(slimmed) < len(svg)
    assert _GLYPH_SCALE.findall(slimmed) == _GLYPH_SCALE.findall(svg) != []


@pytest.mark.parametrize(("width_in", "lines"), [(4.0, 2), (7.0, 1)])
def test_a_legend_stays_within_its_figure(width_in: float, lines: int) -> None:
    policies = ("baseline", "hover", "micro", "skip")
    more = [Line2D([], [], label=f"{altitude_m} m") for altitude_m in (6, 10, 15, 30)]
    with style.styled():
        figure = style.new_figure(width_in, 2.0)
        policy_legend(figure, style.policy_styles(policies), more)
        (legend,) = figure.legends
        figure.draw_without_rendering()
    assert legend.get_window_extent().width <= figure.bbox.width
    assert [text.get_text() for text in legend.get_texts()] == [*policies, "6 m", "10 m", "15 m", "30 m"]
    assert len({round(text.get_window_extent().y0) for text in legend.get_texts()}) == lines


POINTS = st.lists(st.tuples(st.integers(0, 6).map(float), st.integers(0, 6).map(float)), max_size=30)


@given(POINTS)
def test_no_point_of_the_front_is_dominated_and_every_other_is_by_one_of_it(points: list[tuple[float, float]]) -> None:
    front = on_front(points)
    best = [point for point, chosen in zip(points, front, strict=True) if chosen]
    for point, chosen in zip(points, front, strict=True):
        better = [one for one in best if one[0] >= point[0] and one[1] <= point[1] and one != point]
        assert chosen == (not better)
