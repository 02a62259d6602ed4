"""Figures of a report as the page embeds them."""

import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pavetwin.draw import style
from pavetwin.experiments.report.figures import policy_legend, traffic_title
from pavetwin.reports.canvas import slim

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


@pytest.mark.parametrize(
    ("traffic", "title"), [("high", "High traffic"), ("los-C", "los-C traffic"), ("v12-p40", "v12-p40 traffic")]
)
def test_names_of_traffic_keep_their_letters(traffic: str, title: str) -> None:
    assert traffic_title(traffic) == title
