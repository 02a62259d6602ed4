"""The figure that a reader meets first: coverage against time, by policy and altitude, in grey as in colour."""

from collections.abc import Sequence
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.plots.intervals import traffic_title
from pavetwin.experiments.report.plots.tradeoff import options
from pavetwin.experiments.report.study import Group
from pavetwin.experiments.words import heading, level_text

_WIDE: Final = 2.5
"""From this ratio of costs on their axis is logarithmic."""
_MARK_PT: Final = 5.6


def overview(group: Group, gain: Metric, cost: Metric, traffics: Sequence[Any]) -> Figure:
    """A panel a density. Shape and colour are the policy; the filling, from white to full, is the altitude."""
    with style.styled():
        chosen = canvas.looks(group.policies)
        figure, axes = canvas.lattice(1, len(traffics), 2.3)
        found = [options(group, traffic, gain, cost) for traffic in traffics]
        for traffic, cells, panel in zip(traffics, found, axes[0], strict=True):
            for option in cells:
                look = chosen[option.policy]
                x, y = option.cost["mean"] * cost.scale, option.gain["mean"] * gain.scale
                _interval(panel, option.cost, cost.scale, y, look.colour, flat=True)
                _interval(panel, option.gain, gain.scale, x, look.colour, flat=False)
                panel.plot(
                    x, y, look.marker, color=look.colour, markersize=_MARK_PT, markeredgecolor=style.INK,
                    markerfacecolor=_face(group, option.altitude_m, look.colour), markeredgewidth=0.8, zorder=4,
                )  # fmt: skip
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(heading(cost))
        if canvas.spans_wide([option.cost["mean"] for cells in found for option in cells], _WIDE):
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        axes[0][0].set_ylabel(heading(gain))
        canvas.policy_legend(figure, chosen, _altitudes(group))
    return figure


def _interval(axes: Axes, row: Any, scale: float, at: float, colour: str, *, flat: bool) -> None:
    if row["low"] is not None:
        ends = [row["low"] * scale, row["high"] * scale]
        axes.plot(*((ends, [at, at]) if flat else ([at, at], ends)), color=colour, linewidth=0.9, alpha=0.7, zorder=2)


def _face(group: Group, altitude: Any, colour: str) -> str:
    """White for the lowest altitude, the full colour for the highest or the only one."""
    last = len(group.altitudes) - 1
    share = group.altitudes.index(altitude) / last if last else 1.0
    red, green, blue = (1 - share * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def _altitudes(group: Group) -> list[Line2D]:
    if len(group.altitudes) < 2:
        return []
    return [
        Line2D(
            [], [], linestyle="none", marker="o", markersize=_MARK_PT, markeredgecolor=style.INK, markeredgewidth=0.8,
            markerfacecolor=_face(group, altitude, style.INK_SOFT), label=level_text("altitude_m", altitude),
        )
        for altitude in group.altitudes
    ]  # fmt: skip
