"""Means with their 95 % intervals, policies side by side: by altitude, or by whatever else was varied."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class PanelRow:
    """One row of panels: a metric, and where its cells are found."""

    metric: Metric
    label: str
    cell: Callable[[Any, Any, Any], Row | None]
    """The row of the summary for a panel's column, a tick and a policy."""


@dataclass(frozen=True)
class PanelGrid:
    """What the panels have in common."""

    columns: Sequence[Any]
    column_title: Callable[[Any], str]
    ticks: Sequence[Any]
    tick_factor: str
    policies: Sequence[Any]


def by_altitude(group: Group, metrics: Sequence[Metric], traffics: Sequence[Any]) -> Figure:
    """A row of panels a metric, a column a density, altitude from left to right."""

    def strip(metric: Metric) -> PanelRow:
        return PanelRow(metric, heading(metric), lambda traffic, h, policy: group.cell(metric.name, traffic, h, policy))

    frame = PanelGrid(traffics, traffic_title, group.altitudes, "altitude_m", group.policies)
    return draw(frame, [strip(metric) for metric in metrics])


def across(group: Group, factor: str, metric: Metric, traffics: Sequence[Any]) -> Figure:
    """One metric over the levels of another factor: a row of panels an altitude, a column a density.

    Args:
        group: its cells differ in `factor` as well.
    """
    ticks = [levels[factor] for levels in group.study.combinations([factor])]
    by_level = {level: group.at({factor: level}) for level in ticks}

    def strip(altitude: Any) -> PanelRow:
        words = f"{level_text('altitude_m', altitude)}\n{heading(metric)}"
        return PanelRow(metric, words, lambda t, level, policy: by_level[level].cell(metric.name, t, altitude, policy))

    frame = PanelGrid(traffics, traffic_title, ticks, factor, group.policies)
    return draw(frame, [strip(altitude) for altitude in group.altitudes])


def traffic_title(traffic: Any) -> str:
    return f"{level_text('traffic', traffic)} traffic".capitalize()


def draw(frame: PanelGrid, strips: Sequence[PanelRow]) -> Figure:
    with style.styled():
        chosen = canvas.looks(frame.policies)
        one_metric = len({strip.metric.name for strip in strips}) == 1
        figure, axes = canvas.lattice(len(strips), len(frame.columns), 1.38, "all" if one_metric else "row")
        for strip, row in zip(strips, axes, strict=True):
            for column, cell_axes in zip(frame.columns, row, strict=True):
                _panel(cell_axes, frame, strip, column, chosen)
            row[0].set_ylabel(strip.label)
            _scale(row[0], frame, strips if one_metric else [strip])
        for column, top, bottom in zip(frame.columns, axes[0], axes[-1], strict=True):
            canvas.panel_title(top, frame.column_title(column))
            bottom.set_xticks(_places(frame.ticks), [level_text(frame.tick_factor, tick) for tick in frame.ticks])
            bottom.set_xlabel(factor_text(frame.tick_factor))
            bottom.set_xlim(-0.55, _places(frame.ticks)[-1] + 0.55)
        canvas.policy_legend(figure, chosen)
    return figure


def _panel(axes: Axes, frame: PanelGrid, strip: PanelRow, column: Any, chosen: canvas.Looks) -> None:
    axes.grid(axis="x", visible=False)
    for at, policy in enumerate(frame.policies):
        rows = [strip.cell(column, tick, policy) for tick in frame.ticks]
        shift = _SPREAD * ((at + 0.5) / len(frame.policies) - 0.5)
        mean, low, high = (_values(strip.metric, rows, name) for name in ("mean", "low", "high"))
        look = chosen[policy]
        reach = np.nan_to_num(np.stack([mean - low, high - mean])).clip(min=0.0)
        dash = look.dash if _in_order(frame.ticks) else "none"
        axes.errorbar(
            _places(frame.ticks) + shift, mean, yerr=reach, color=look.colour, marker=look.marker, markersize=4,
            linestyle=dash, linewidth=0.6, elinewidth=1.2, alpha=0.95,
        )  # fmt: skip


def _places(ticks: Sequence[Any]) -> Float64Array:
    """(n,) where ticks stand, 1 apart where they are closest: to scale between numbers, if none would be far away."""
    even = np.arange(len(ticks), dtype=np.float64)
    if len(ticks) < 3 or not _in_order(ticks) or list(ticks) != sorted(ticks):
        return even
    values = np.array(ticks, dtype=np.float64)
    scaled = (values - values[0]) / np.diff(values).min()
    return scaled if scaled[-1] <= _WIDEST * even[-1] else even


def _in_order(ticks: Sequence[Any]) -> bool:
    """Whether a line from tick to tick means something: between numbers, not between names."""
    return all(isinstance(tick, int | float) and not isinstance(tick, bool) for tick in ticks)


def _scale(axes: Axes, frame: PanelGrid, strips: Sequence[PanelRow]) -> None:
    """Logarithmic where values span a wide range; else from 0 where that costs little room. A share ends at 100."""
    metric = strips[0].metric
    places = list(product(frame.columns, frame.ticks, frame.policies))
    found = [strip.cell(*place) for strip in strips for place in places]
    ends = np.concatenate([_values(metric, found, name) for name in ("mean", "low", "high")])
    ends = ends[np.isfinite(ends)]
    if canvas.spans_wide(ends.tolist()):
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


def _values(metric: Metric, rows: Sequence[Row | None], name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n,) shown values, nan where there is none."""
    found = (np.nan if row is None or row[name] is None else row[name] * metric.scale for row in rows)
    return np.fromiter(found, dtype=np.float64, count=len(rows))
