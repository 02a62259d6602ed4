"""Means with their 95 % intervals, policies side by side: by altitude, or by whatever else was varied."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.study import Group, Row
from pavetwin.experiments.words import factor_text, heading, level_text

_SPREAD: Final = 0.5
"""Of the distance between two ticks, what the policies at one tick take."""
_WIDEST: Final = 2.5
"""Numbers on the axis are to scale where that makes it at most so many times as long."""
_FROM_ZERO: Final = 0.35
"""An axis begins at 0 when the smallest value is below this share of the largest."""


WITHOUT: Final = "without"
"""The tick of policies that lack the factor."""

PanelRow = tuple[Metric, str, Callable[[Any, Any, Any], Row | None]]
"""A metric, the label of its row of panels, and the summary's row for a density, a tick and a policy."""


def by_altitude(group: Group, metrics: Sequence[Metric], traffics: Sequence[Any]) -> Figure:
    """A row of panels a metric, a column a density, altitude from left to right."""
    rows: list[PanelRow] = [(metric, heading(metric), partial(group.cell, metric.name)) for metric in metrics]
    return _draw(group, rows, traffics, "altitude_m", group.altitudes)


def across(group: Group, factor: str, metric: Metric, traffics: Sequence[Any]) -> Figure:
    """One metric over the levels of another factor: a row of panels an altitude, a column a density. Policies that lack
    the factor stand before its levels.

    Args:
        group: its cells differ in `factor` as well.
    """
    levels = [key[factor] for key in group.study.combinations([factor])]
    ticks = [None, *levels] if group.lacking(factor) else levels
    by_level = {level: group.at({factor: level}) for level in ticks}

    def cell(altitude: Any, traffic: Any, level: Any, policy: Any) -> Row | None:
        found = by_level[level].cell(metric.name, traffic, altitude, policy)
        return found if found is not None and found[factor] == level else None

    def row(altitude: Any) -> PanelRow:
        return metric, f"{level_text('altitude_m', altitude)}\n{heading(metric)}", partial(cell, altitude)

    return _draw(group, [row(altitude) for altitude in group.altitudes], traffics, factor, ticks)


def traffic_title(traffic: Any) -> str:
    """Names such as `los-C` keep their letters."""
    text = f"{level_text('traffic', traffic)} traffic"
    return text.capitalize() if str(traffic).isalpha() else text


def _draw(group: Group, rows: Sequence[PanelRow], traffics: Sequence[Any], factor: str, ticks: Sequence[Any]) -> Figure:
    with style.styled():
        chosen, places = canvas.looks(group.policies), _places(ticks)
        one_metric = len({metric.name for metric, _, _ in rows}) == 1
        figure, axes = canvas.lattice(len(rows), len(traffics), 1.38, "all" if one_metric else "row")
        found = [{at: cell(*at) for at in product(traffics, ticks, group.policies)} for _, _, cell in rows]
        for (metric, label, _), cells, panels in zip(rows, found, axes, strict=True):
            for traffic, panel in zip(traffics, panels, strict=True):
                panel.grid(axis="x", visible=False)
                for at, (policy, look) in enumerate(chosen.items()):
                    line = [cells[traffic, tick, policy] for tick in ticks]
                    shift = _SPREAD * ((at + 0.5) / len(chosen) - 0.5)
                    _line(panel, metric, line, places + shift, look, joined=_in_order(ticks))
            panels[0].set_ylabel(label)
            _scale(panels[0], metric, [row for each in (found if one_metric else [cells]) for row in each.values()])
        for traffic, top, bottom in zip(traffics, axes[0], axes[-1], strict=True):
            canvas.panel_title(top, traffic_title(traffic))
            bottom.set_xticks(places, [WITHOUT if tick is None else level_text(factor, tick) for tick in ticks])
            bottom.set(xlabel=factor_text(factor), xlim=(places[0] - 0.55, places[-1] + 0.55))
        canvas.policy_legend(figure, chosen)
    return figure


def _line(
    axes: Axes, metric: Metric, rows: Sequence[Row | None], x: Float64Array, look: style.PolicyStyle, *, joined: bool
) -> None:
    mean, low, high = (_values(metric, rows, name) for name in ("mean", "low", "high"))
    reach = np.nan_to_num(np.stack([mean - low, high - mean])).clip(min=0.0)
    axes.errorbar(
        x, mean, yerr=reach, color=look.colour, marker=look.marker, markersize=4,
        linestyle=look.dash if joined else "none", linewidth=0.6, elinewidth=1.2, alpha=0.95,
    )  # fmt: skip


def _places(ticks: Sequence[Any]) -> Float64Array:
    """(n,) where ticks stand, 1 apart where they are closest: to scale between numbers, if none would be far away."""
    if ticks[0] is None and len(ticks) > 1:
        return np.array([-1.0, *_places(ticks[1:])])
    even = np.arange(len(ticks), dtype=np.float64)
    if len(ticks) < 3 or not _in_order(ticks) or list(ticks) != sorted(ticks):
        return even
    values = np.array(ticks, dtype=np.float64)
    scaled = (values - values[0]) / np.diff(values).min()
    return scaled if scaled[-1] <= _WIDEST * even[-1] else even


def _in_order(ticks: Sequence[Any]) -> bool:
    """Whether a line from tick to tick means something: between numbers, not between names."""
    return all(isinstance(tick, int | float) and not isinstance(tick, bool) for tick in ticks if tick is not None)


def _scale(axes: Axes, metric: Metric, rows: Sequence[Row | None]) -> None:
    """Logarithmic where values span a wide range, but for points of an index; else from 0 where that costs little room.
    A share ends at 100."""
    ends = np.concatenate([_values(metric, rows, name) for name in ("mean", "low", "high")])
    ends = ends[np.isfinite(ends)]
    if metric.unit != "points" and canvas.spans_wide(ends.tolist()):
        canvas.logarithmic(axes.yaxis)
        return
    if not len(ends):
        return
    low, high = float(ends.min()), float(ends.max())
    low = 0.0 if 0 <= low < _FROM_ZERO * high else low
    high = high if high > low else low + 1.0
    margin = 0.07 * (high - low)
    top = min(high + margin, 103.0) if metric.unit == "%" else high + margin
    axes.set_ylim(low - margin, max(top, high))


def _values(metric: Metric, rows: Sequence[Row | None], name: str) -> Float64Array:
    """(n,) shown values, nan where there is none."""
    found = (np.nan if row is None or row[name] is None else row[name] * metric.scale for row in rows)
    return np.fromiter(found, dtype=np.float64, count=len(rows))
