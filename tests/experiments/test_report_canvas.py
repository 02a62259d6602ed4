"""Figures of a report as the page embeds them."""

import re
from pathlib import Path

from matplotlib.figure import Figure

from pavetwin.experiments.report.canvas import slim

_GLYPH_SCALE = re.compile(r"scale\(([^)]*)\)")


def test_a_slimmed_figure_keeps_the_size_of_its_letters(tmp_path: Path) -> None:
    figure = Figure(figsize=(3, 1))
    figure.text(0.1, 0.5, "Low traffic", fontsize=7.5)
    figure.savefig(tmp_path / "figure.svg")
    svg = (tmp_path / "figure.svg").read_text(encoding="utf-8")
    slimmed = slim(svg)
    assert len(slimmed) < len(svg)
    assert _GLYPH_SCALE.findall(slimmed) == _GLYPH_SCALE.findall(svg) != []
