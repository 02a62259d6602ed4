"""Paired differences of each policy to the reference: a row a comparison, its interval, and its corrected p."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any, Final

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report.canvas import WIDTH_IN, Looks, looks, panel_title, policy_legend
from pavetwin.experiments.report.study import METRIC, Group, Row
from pavetwin.experiments.report.words import level_text, p_text

LEVEL: Final = 0.05
"""A comparison counts as different when its corrected p is below this."""

_ROW_IN: Final = 0.15
Places = list[tuple[Any, Any, Any]]
"""Density, altitude, policy of each row, from the top."""


def compared(group: Group) -> list[Any]:
    """The policies that are compared with the reference."""
    found = set(group.differences["policy"].to_list()) if group.differences.height else set()
    return [policy for policy in group.policies if policy in found]


def places(group: Group, traffics: Sequence[Any]) -> Places:
    """The comparisons of these densities in the order of the table."""
    found = set(group.differences.select("traffic", "altitude_m", "policy").iter_rows())
    grid = [(t, h, p) for t in traffics for h in group.altitudes for p in compared(group)]
    return [place for place in grid if place in found]


def forest(group: Group, metrics: Sequence[Metric], shown: Places) -> Figure:
    """A panel a metric over the same rows. Filled marks are different after the correction."""
    with style.styled():
        chosen = looks(group.policies)
        figure = style.new_figure(WIDTH_IN, 0.75 + _ROW_IN * len(shown))
        figure.set_layout_engine("constrained", w_pad=0.03)
        panels = figure.subplots(1, len(metrics), squeeze=False, sharey=True)[0]
        for axes, metric in zip(panels, metrics, strict=True):
            _panel(axes, metric, shown, _of_metric(group, metric), chosen)
        _name_rows(panels[0], shown)
        policy_legend(figure, {policy: chosen[policy] for policy in compared(group)})
    return figure


def _of_metric(group: Group, metric: Metric) -> Mapping[tuple[Any, Any, Any], Row]:
    rows = group.differences.filter(pl.col(METRIC) == metric.name).iter_rows(named=True)
    return {(row["traffic"], row["altitude_m"], row["policy"]): row for row in rows}


def _panel(axes: Axes, metric: Metric, shown: Places, rows: Mapping[tuple[Any, Any, Any], Row], chosen: Looks) -> None:
    axes.axvline(0.0, color=style.INK_SOFT, linewidth=0.8, zorder=1)
    axes.grid(axis="y", visible=False)
    for y, place in enumerate(shown):
        row = rows.get(place)
        if row is None or row["mean"] is None:
            continue
        _mark(axes, y, row, metric.scale, chosen[place[2]])
        axes.annotate(
            p_text(row["p_corrected"]), (1.0, y), xycoords=("axes fraction", "data"), xytext=(3, 0),
            textcoords="offset points", va="center_baseline", fontsize=5.4,
            color=style.INK if _differs(row) else style.INK_SOFT,
        )  # fmt: skip
    axes.set_ylim(len(shown) - 0.4, -0.6)
    unit = {"%": "percentage points", "% of a battery": "points of battery %"}.get(metric.unit, metric.unit)
    axes.set_xlabel(f"difference, {unit}" if unit else "difference")
    panel_title(axes, metric.label)
    axes.annotate(
        "p", (1.0, -0.9), xycoords=("axes fraction", "data"), xytext=(5, 0), textcoords="offset points",
        fontsize=6, style="italic", color=style.INK_SOFT, annotation_clip=False,
    )  # fmt: skip


def _mark(axes: Axes, y: int, row: Row, scale: float, look: tuple[str, str]) -> None:
    colour, marker = look
    if row["low"] is not None:
        axes.plot([row["low"] * scale, row["high"] * scale], [y, y], color=colour, linewidth=1.3)
    face = colour if _differs(row) else style.PAPER
    axes.plot(row["mean"] * scale, y, marker, color=colour, markerfacecolor=face, markersize=4.2, markeredgewidth=0.9)


def _differs(row: Row) -> bool:
    return row["p_corrected"] is not None and row["p_corrected"] < LEVEL


def _name_rows(axes: Axes, shown: Places) -> None:
    """Density and altitude beside each block, with every second block shaded in all panels."""
    blocks = [
        (traffic, altitude, [y for y, _ in rows])
        for (traffic, altitude), rows in groupby(enumerate(shown), key=lambda item: item[1][:2])
    ]
    figure = axes.get_figure(root=True)
    assert figure is not None
    for panel in figure.axes:
        for at, (_, _, ys) in enumerate(blocks):
            if at % 2 == 0:
                panel.axhspan(ys[0] - 0.5, ys[-1] + 0.5, color=style.GROUND, zorder=0, linewidth=0)
        panel.tick_params(axis="y", length=0)
    words = [
        f"{level_text('traffic', traffic)}  {level_text('altitude_m', altitude)}" for traffic, altitude, _ in blocks
    ]
    axes.set_yticks([(ys[0] + ys[-1]) / 2 for _, _, ys in blocks], words)
    axes.tick_params(axis="y", labelcolor=style.INK)
