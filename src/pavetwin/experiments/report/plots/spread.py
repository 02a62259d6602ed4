"""How a metric spreads over missions: every mission a dot, boxes over them, on a logarithmic axis for heavy tails."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.plots.intervals import traffic_title
from pavetwin.experiments.report.study import Group
from pavetwin.experiments.words import heading, level_text

_GOLDEN: Final = 0.6180339887498949
"""Multiples of it, modulo 1, lie evenly: dots beside each other without a random number."""
_MANY: Final = 1500
"""With more dots than this they are drawn as one picture, so that the page stays small."""


def spread(group: Group, metric: Metric, traffics: Sequence[Any]) -> Figure:
    """A column a density; rows by altitude, and in it by policy."""
    with style.styled():
        chosen = canvas.looks(group.policies)
        height = 0.3 + 0.155 * len(group.altitudes) * (len(group.policies) + 0.8)
        figure, axes = canvas.lattice(1, len(traffics), height)
        known = group.result.filter(pl.col(metric.name).is_not_null())
        positive = bool(known.height) and float(known[metric.name].min()) > 0.0  # type: ignore[arg-type]
        for traffic, panel in zip(traffics, axes[0], strict=True):
            _panel(panel, group, metric, _of(known, "traffic", traffic), chosen, as_picture=known.height > _MANY)
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(heading(metric))
        if positive and metric.more_is_better is False:
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        canvas.policy_legend(figure, chosen)
    return figure


def _panel(
    axes: Axes, group: Group, metric: Metric, known: pl.DataFrame, chosen: canvas.Looks, *, as_picture: bool
) -> None:
    block = len(group.policies) + 0.8
    for at, altitude in enumerate(group.altitudes):
        of_altitude = _of(known, "altitude_m", altitude)
        for below, policy in enumerate(group.policies):
            values = _of(of_altitude, "policy", policy)[metric.name].to_numpy().astype(np.float64) * metric.scale
            if len(values):
                _row(axes, values, at * block + below, chosen[policy], as_picture=as_picture)
    middles = [at * block + (len(group.policies) - 1) / 2 for at in range(len(group.altitudes))]
    axes.set_yticks(middles, [level_text("altitude_m", altitude) for altitude in group.altitudes])
    axes.set_ylim(len(group.altitudes) * block - 0.9, -0.9)
    axes.tick_params(axis="y", length=0, labelcolor=style.INK)
    axes.grid(axis="y", visible=False)


def _row(axes: Axes, values: Float64Array, y: float, look: style.PolicyStyle, *, as_picture: bool) -> None:
    colour = look.colour
    jitter = ((np.arange(len(values)) + 1) * _GOLDEN % 1.0 - 0.5) * 0.62
    axes.plot(
        values, y + jitter, ".", color=colour, markersize=3.6, markeredgewidth=0, alpha=0.6, rasterized=as_picture
    )
    box = {"color": style.INK, "linewidth": 0.6}
    # The percentiles of the tables: matplotlib's own whiskers end at the last value within them.
    names = ("whislo", "q1", "med", "q3", "whishi")
    ends = dict(zip(names, np.quantile(values, (0.05, 0.25, 0.5, 0.75, 0.95)).tolist(), strict=True))
    axes.bxp(
        [ends], positions=[y], orientation="horizontal", widths=0.62, showfliers=False,
        manage_ticks=False, boxprops=box, whiskerprops=box, capprops=box,
        medianprops={"color": colour, "linewidth": 2.0}, zorder=4,
    )  # fmt: skip


def _of(frame: pl.DataFrame, column: str, level: Any) -> pl.DataFrame:
    """The rows of a level; all of them where the level stands for all."""
    return frame.filter(pl.col(column) == level) if level is not None else frame
