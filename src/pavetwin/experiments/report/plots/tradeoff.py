"""What coverage costs: mean coverage over mean time or energy, and which cells no other dominates."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.plots.intervals import traffic_title
from pavetwin.experiments.report.study import Group, Row
from pavetwin.experiments.words import heading, level_text

_SIZES_PT: Final = (3.4, 5.0, 6.6, 8.0, 9.2)
"""Of marks, from the lowest altitude up."""
_WIDE: Final = 2.5
"""From this ratio of costs on their axis is logarithmic: most options are cheap and would overlap."""

GainAndCost = tuple[float, float]
"""Gain (more is better) and cost (less is better)."""


@dataclass(frozen=True)
class Option:
    """One altitude and policy in one density, with its means."""

    altitude_m: Any
    policy: Any
    gain: Row
    cost: Row
    on_front: bool


def dominates(one: GainAndCost, other: GainAndCost) -> bool:
    """Whether `one` is at least as good in both and better in one."""
    return one[0] >= other[0] and one[1] <= other[1] and one != other


def on_front(points: Sequence[GainAndCost]) -> list[bool]:
    """For each point, whether none dominates it (the Pareto front). Equal points are on the front together."""
    return [not any(dominates(one, point) for one in points) for point in points]


def options(group: Group, traffic: Any, gain: Metric, cost: Metric) -> list[Option]:
    """The cells of a density in which both means are defined.

    One that failed in a mission which another flew is not on the front: their means are over different missions.
    """
    pairs = [
        (*cell, group.cell(gain.name, traffic, *cell), group.cell(cost.name, traffic, *cell))
        for cell in product(group.altitudes, group.policies)
    ]
    known = [(h, p, a, b) for h, p, a, b in pairs if a and b and a["mean"] is not None and b["mean"] is not None]
    whole = [cell for cell in known if not group.failed_alone(traffic, *cell[:2])]
    front = on_front([(a["mean"], b["mean"]) for _, _, a, b in whole])
    best = {cell[:2] for cell, chosen in zip(whole, front, strict=True) if chosen}
    return [Option(h, p, a, b, (h, p) in best) for h, p, a, b in known]


def tradeoff(group: Group, gain: Metric, cost: Metric, traffics: Sequence[Any]) -> Figure:
    """A panel a density: mark and colour a policy, size an altitude, strong marks on the front."""
    with style.styled():
        chosen = canvas.looks(group.policies)
        figure, axes = canvas.lattice(1, len(traffics), 2.5)
        found = [options(group, traffic, gain, cost) for traffic in traffics]
        wide = canvas.spans_wide([option.cost["mean"] for cells in found for option in cells], _WIDE)
        for traffic, cells, panel in zip(traffics, found, axes[0], strict=True):
            _panel(panel, group, cells, (gain, cost), chosen)
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(f"Mean {heading(cost)[:1].lower()}{heading(cost)[1:]}")
        if wide:
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        axes[0][0].set_ylabel(f"Mean {heading(gain)[:1].lower()}{heading(gain)[1:]}")
        canvas.policy_legend(
            figure, chosen, [*_sizes(group), Line2D([], [], color=style.INK, linewidth=0.9, label="front")]
        )
    return figure


def _panel(
    axes: Axes, group: Group, cells: Sequence[Option], metrics: tuple[Metric, Metric], chosen: canvas.Looks
) -> None:
    gain, cost = metrics
    for option in cells:
        look, strong = chosen[option.policy], 1.0 if option.on_front else 0.4
        x, y = option.cost["mean"] * cost.scale, option.gain["mean"] * gain.scale
        for row, scale, place in ((option.cost, cost.scale, 0), (option.gain, gain.scale, 1)):
            if row["low"] is not None:
                ends = [row["low"] * scale, row["high"] * scale]
                line = (ends, [y, y]) if place == 0 else ([x, x], ends)
                axes.plot(*line, color=look.colour, linestyle=look.dash, linewidth=0.7, alpha=0.45 * strong, zorder=2)
        axes.plot(
            x, y, look.marker, color=look.colour, markersize=_size(group, option.altitude_m), alpha=strong,
            markeredgecolor=style.INK if option.on_front else style.PAPER, markeredgewidth=0.7, zorder=4,
        )  # fmt: skip
    _front_line(axes, [o for o in cells if o.on_front], gain, cost)


def _front_line(axes: Axes, front: Sequence[Option], gain: Metric, cost: Metric) -> None:
    """Steps: at a cost between two cells of the front, the cheaper one is the best there is."""
    ends = sorted((o.cost["mean"] * cost.scale, o.gain["mean"] * gain.scale) for o in front)
    if ends:
        axes.step([x for x, _ in ends], [y for _, y in ends], where="post", color=style.INK, linewidth=0.9, zorder=3)


def _sizes(group: Group) -> list[Line2D]:
    if len(group.altitudes) < 2:
        return []
    look: dict[str, Any] = {"linestyle": "none", "marker": "o", "color": style.INK_FAINT}
    return [
        Line2D([], [], **look, markersize=_size(group, altitude), label=level_text("altitude_m", altitude))
        for altitude in group.altitudes
    ]


def _size(group: Group, altitude: Any) -> float:
    at = group.altitudes.index(altitude) if len(group.altitudes) > 1 else 1
    return _SIZES_PT[min(at, len(_SIZES_PT) - 1)]
