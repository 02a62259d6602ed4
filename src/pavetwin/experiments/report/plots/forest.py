"""Paired differences to a reference: a row a comparison, its interval, and its corrected p."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, Final

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.study import AXES, METRIC, Group, Row
from pavetwin.experiments.statistics.paired import is_significant
from pavetwin.experiments.words import factor_text, level_text, p_text

_ROW_IN: Final = 0.15
RowLevels = tuple[Any, ...]
"""Density, altitude, levels of what is swept, and policy of a row."""


def axes_of(group: Group) -> tuple[str, ...]:
    return ("traffic", "altitude_m", *group.swept, "policy")


def places(group: Group, differences: pl.DataFrame, traffics: Sequence[Any]) -> list[RowLevels]:
    """The comparisons of these densities in the order of the table, from the top."""
    axes = axes_of(group)
    found = {place for place in differences.select(axes).iter_rows() if place[0] in traffics}
    return sorted(found, key=lambda place: group.study.place(dict(zip(axes, place, strict=True))))


def forest(group: Group, differences: pl.DataFrame, metrics: Sequence[Metric], shown: Sequence[RowLevels]) -> Figure:
    """A panel a metric over the same rows. Filled marks are significant."""
    with style.styled():
        chosen = canvas.looks(group.policies)
        figure, panels = canvas.beside_each_other(len(metrics), 0.75 + _ROW_IN * max(len(shown), 2))
        for axes, metric in zip(panels, metrics, strict=True):
            rows = differences.filter(pl.col(METRIC) == metric.name).iter_rows(named=True)
            _panel(axes, metric, shown, {tuple(row[name] for name in axes_of(group)): row for row in rows}, chosen)
        _name_rows(panels[0], axes_of(group), shown)
        canvas.policy_legend(figure, chosen, drawn={place[-1] for place in shown})
    return figure


def _panel(
    axes: Axes, metric: Metric, shown: Sequence[RowLevels], rows: Mapping[RowLevels, Row], chosen: canvas.Looks
) -> None:
    axes.axvline(0.0, color=style.INK_SOFT, linewidth=0.8, zorder=1)
    axes.grid(axis="y", visible=False)
    for y, place in enumerate(shown):
        row = rows.get(place)
        if row is None or row["mean"] is None:
            continue
        _mark(axes, y, row, metric.scale, chosen[place[-1]])
        axes.annotate(
            p_text(row["p_corrected"]), (1.0, y), xycoords=("axes fraction", "data"), xytext=(3, 0),
            textcoords="offset points", va="center_baseline", fontsize=5.4,
            color=style.INK if is_significant(row) else style.INK_SOFT,
        )  # fmt: skip
    axes.set_ylim(len(shown) - 0.4, -0.6)
    unit = {"%": "percentage points", "% of a battery": "points of battery %"}.get(metric.unit, metric.unit)
    axes.set_xlabel(f"difference, {unit}" if unit else "difference")
    canvas.panel_title(axes, metric.label)
    axes.annotate(
        "p", (1.0, -0.9), xycoords=("axes fraction", "data"), xytext=(5, 0), textcoords="offset points",
        fontsize=6, style="italic", color=style.INK_SOFT, annotation_clip=False,
    )  # fmt: skip


def _mark(axes: Axes, y: int, row: Row, scale: float, look: style.PolicyStyle) -> None:
    colour = look.colour
    if row["low"] is not None:
        axes.plot([row["low"] * scale, row["high"] * scale], [y, y], color=colour, linewidth=1.3, linestyle=look.dash)
    face = colour if is_significant(row) else style.PAPER
    axes.plot(
        row["mean"] * scale, y, look.marker, color=colour, markerfacecolor=face, markersize=4.2, markeredgewidth=0.9
    )


def _name_rows(axes: Axes, factors: Sequence[str], shown: Sequence[RowLevels]) -> None:
    """The common label of a block of policies beside it, with every second block shaded in all panels."""
    blocks = [(place, [y for y, _ in rows]) for place, rows in groupby(enumerate(shown), key=lambda item: item[1][:-1])]
    figure = axes.get_figure(root=True)
    assert figure is not None
    for panel in figure.axes:
        for at, (_, ys) in enumerate(blocks):
            if at % 2 == 0:
                panel.axhspan(ys[0] - 0.5, ys[-1] + 0.5, color=style.GROUND, zorder=0, linewidth=0)
        panel.tick_params(axis="y", length=0)
    words = [
        "  ".join(
            _level(factor, level)
            for factor, level in zip(factors[:-1], place, strict=True)
            if factor in AXES or level is not None
        )
        for place, _ in blocks
    ]
    axes.set_yticks([(ys[0] + ys[-1]) / 2 for _, ys in blocks], words)
    axes.tick_params(axis="y", labelcolor=style.INK)


def _level(factor: str, level: Any) -> str:
    """`high`, `6 m`, `tau_o 0.5`."""
    text = level_text(factor, level)
    return text if factor in AXES else f"{factor_text(factor)} {text}"
