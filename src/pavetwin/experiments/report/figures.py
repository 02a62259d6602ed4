"""Figures of a study: means, differences, trade-offs, spread and effects."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, product
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report.study import AXES, METRIC, Group, Row
from pavetwin.experiments.statistics.paired import is_significant
from pavetwin.experiments.statistics.simultaneous import ALPHA
from pavetwin.experiments.words import factor_text, heading, level_text, term_text
from pavetwin.reports import canvas
from pavetwin.reports.words import number, p_text

PolicyStyles = Mapping[Any, style.PolicyStyle]
"""How each policy is drawn."""

_WIDE_COSTS: Final = 2.5  # From this ratio of costs on their axis is logarithmic
_MARK_PT: Final = 5.6


def overview(group: Group, gain: Metric, cost: Metric, traffics: Sequence[Any]) -> Figure:
    """A panel a density. Shape and colour are the policy; the filling, from white to full, is the altitude."""
    with style.styled():
        chosen = style.policy_styles(group.policies)
        figure, axes = lattice(1, len(traffics), 2.3)
        found = [options(group, traffic, gain, cost) for traffic in traffics]
        for traffic, cells, panel in zip(traffics, found, axes[0], strict=True):
            for option in cells:
                look = chosen[option.policy]
                x, y = _interval_lines(panel, option, gain, cost, color=look.colour, linewidth=0.9, alpha=0.7)
                panel.plot(
                    x, y, look.marker, color=look.colour, markersize=_MARK_PT, markeredgecolor=style.INK,
                    markerfacecolor=_altitude_fill(group, option.altitude_m, look.colour),
                    markeredgewidth=0.8, zorder=4,
                )  # fmt: skip
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(heading(cost))
        if canvas.spans_wide([option.cost["mean"] for cells in found for option in cells], _WIDE_COSTS):
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        axes[0][0].set_ylabel(heading(gain))
        policy_legend(figure, chosen, _altitude_legend(group))
    return figure


def _interval_lines(axes: Axes, option: "Option", gain: Metric, cost: Metric, **look: Any) -> tuple[float, float]:
    """Draw the intervals of an option's means, and return its place."""
    x, y = option.cost["mean"] * cost.scale, option.gain["mean"] * gain.scale
    if option.cost["low"] is not None:
        axes.plot([option.cost["low"] * cost.scale, option.cost["high"] * cost.scale], [y, y], zorder=2, **look)
    if option.gain["low"] is not None:
        axes.plot([x, x], [option.gain["low"] * gain.scale, option.gain["high"] * gain.scale], zorder=2, **look)
    return x, y


def _altitude_fill(group: Group, altitude: Any, colour: str) -> str:
    """White for the lowest altitude, the full colour for the highest or the only one."""
    last = len(group.altitudes) - 1
    share = group.altitudes.index(altitude) / last if last else 1.0
    red, green, blue = (1 - share * (1 - part) for part in to_rgb(colour))
    return to_hex((red, green, blue))


def _altitude_legend(group: Group) -> list[Line2D]:
    if len(group.altitudes) < 2:
        return []
    return [
        Line2D(
            [], [], linestyle="none", marker="o", markersize=_MARK_PT, markeredgecolor=style.INK, markeredgewidth=0.8,
            markerfacecolor=_altitude_fill(group, altitude, style.INK_SOFT), label=level_text("altitude_m", altitude),
        )
        for altitude in group.altitudes
    ]  # fmt: skip


_SPREAD: Final = 0.5  # Share of the distance between two ticks that the policies at one tick take
_WIDEST: Final = 2.5  # Numbers on the axis are to scale where that makes it at most so many times as long
_FROM_ZERO: Final = 0.35  # An axis begins at 0 when the smallest value is below this share of the largest


WITHOUT: Final = "without"
"""The tick of policies without the factor."""

PanelRow = tuple[Metric, str, Callable[[Any, Any, Any], Row | None]]
"""A metric, the label of its row of panels, and the summary's row for a density, a tick and a policy."""


def by_altitude(group: Group, metrics: Sequence[Metric], traffics: Sequence[Any]) -> Figure:
    """A row of panels a metric, a column a density, altitude from left to right."""
    rows: list[PanelRow] = [(metric, heading(metric), partial(group.cell, metric.name)) for metric in metrics]
    return _interval_panels(group, rows, traffics, "altitude_m", group.altitudes)


def across(group: Group, factor: str, metric: Metric, traffics: Sequence[Any]) -> Figure:
    """One metric over the levels of another factor: one row of panels per altitude, one column per density. Policies
    without the factor stand before its levels.

    Args:
        group: its cells differ in `factor` as well.
    """
    levels = [key[factor] for key in group.study.combinations([factor])]
    ticks = [None, *levels] if group.without(factor) else levels
    by_level = {level: group.at({factor: level}) for level in ticks}

    def cell(altitude: Any, traffic: Any, level: Any, policy: Any) -> Row | None:
        found = by_level[level].cell(metric.name, traffic, altitude, policy)
        return found if found is not None and found[factor] == level else None

    def row(altitude: Any) -> PanelRow:
        return metric, f"{level_text('altitude_m', altitude)}\n{heading(metric)}", partial(cell, altitude)

    return _interval_panels(group, [row(altitude) for altitude in group.altitudes], traffics, factor, ticks)


def traffic_title(traffic: Any) -> str:
    """Names such as `los-C` keep their letters."""
    text = f"{level_text('traffic', traffic)} traffic"
    return text.capitalize() if str(traffic).isalpha() else text


def _interval_panels(
    group: Group, rows: Sequence[PanelRow], traffics: Sequence[Any], factor: str, ticks: Sequence[Any]
) -> Figure:
    with style.styled():
        chosen, places = style.policy_styles(group.policies), _tick_places(ticks)
        one_metric = len({metric.name for metric, _, _ in rows}) == 1
        figure, axes = lattice(len(rows), len(traffics), 1.38, "all" if one_metric else "row")
        found = [{at: cell(*at) for at in product(traffics, ticks, group.policies)} for _, _, cell in rows]
        for (metric, label, _), cells, panels in zip(rows, found, axes, strict=True):
            for traffic, panel in zip(traffics, panels, strict=True):
                panel.grid(axis="x", visible=False)
                for at, (policy, look) in enumerate(chosen.items()):
                    line = [cells[traffic, tick, policy] for tick in ticks]
                    shift = _SPREAD * ((at + 0.5) / len(chosen) - 0.5)
                    _interval_series(panel, metric, line, places + shift, look, joined=_in_order(ticks))
            panels[0].set_ylabel(label)
            _scale_axis(
                panels[0], metric, [row for each in (found if one_metric else [cells]) for row in each.values()]
            )
        for traffic, top, bottom in zip(traffics, axes[0], axes[-1], strict=True):
            canvas.panel_title(top, traffic_title(traffic))
            bottom.set_xticks(places, [WITHOUT if tick is None else level_text(factor, tick) for tick in ticks])
            bottom.set(xlabel=factor_text(factor), xlim=(places[0] - 0.55, places[-1] + 0.55))
        policy_legend(figure, chosen)
    return figure


def _interval_series(
    axes: Axes, metric: Metric, rows: Sequence[Row | None], x: Float64Array, look: style.PolicyStyle, *, joined: bool
) -> None:
    mean, low, high = (_values(metric, rows, name) for name in ("mean", "low", "high"))
    reach = np.nan_to_num(np.stack([mean - low, high - mean])).clip(min=0.0)
    axes.errorbar(
        x, mean, yerr=reach, color=look.colour, marker=look.marker, markersize=4,
        linestyle=look.dash if joined else "none", linewidth=0.6, elinewidth=1.2, alpha=0.95,
    )  # fmt: skip


def _tick_places(ticks: Sequence[Any]) -> Float64Array:
    """(n,) where ticks stand, 1 apart where they are closest: to scale between numbers, if none would be far away."""
    if ticks[0] is None and len(ticks) > 1:
        return np.array([-1.0, *_tick_places(ticks[1:])])
    even = np.arange(len(ticks), dtype=np.float64)
    if len(ticks) < 3 or not _in_order(ticks) or list(ticks) != sorted(ticks):
        return even
    values = np.array(ticks, dtype=np.float64)
    scaled = (values - values[0]) / np.diff(values).min()
    return scaled if scaled[-1] <= _WIDEST * even[-1] else even


def _in_order(ticks: Sequence[Any]) -> bool:
    """True if a line from tick to tick is meaningful: between numbers, not between names."""
    return all(isinstance(tick, int | float) and not isinstance(tick, bool) for tick in ticks if tick is not None)


def _scale_axis(axes: Axes, metric: Metric, rows: Sequence[Row | None]) -> None:
    """Make the axis logarithmic if values span a wide range, except points of an index; otherwise start it at 0 if that
    costs little room. A share ends at 100."""
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
        chosen = style.policy_styles(group.policies)
        figure, panels = canvas.side_by_side(len(metrics), 0.75 + _ROW_IN * max(len(shown), 2))
        for axes, metric in zip(panels, metrics, strict=True):
            rows = differences.filter(pl.col(METRIC) == metric.name).iter_rows(named=True)
            _forest_panel(
                axes, metric, shown, {tuple(row[name] for name in axes_of(group)): row for row in rows}, chosen
            )
        _label_rows(panels[0], axes_of(group), shown)
        policy_legend(figure, chosen, drawn={place[-1] for place in shown})
    return figure


def _forest_panel(
    axes: Axes, metric: Metric, shown: Sequence[RowLevels], rows: Mapping[RowLevels, Row], chosen: PolicyStyles
) -> None:
    axes.axvline(0.0, color=style.INK_SOFT, linewidth=0.8, zorder=1)
    axes.grid(axis="y", visible=False)
    for y, place in enumerate(shown):
        row = rows.get(place)
        if row is None or row["mean"] is None:
            continue
        _forest_mark(axes, y, row, metric.scale, chosen[place[-1]])
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


def _forest_mark(axes: Axes, y: int, row: Row, scale: float, look: style.PolicyStyle) -> None:
    colour = look.colour
    if row["low"] is not None:
        axes.plot([row["low"] * scale, row["high"] * scale], [y, y], color=colour, linewidth=1.3, linestyle=look.dash)
    face = colour if is_significant(row) else style.PAPER
    axes.plot(
        row["mean"] * scale, y, look.marker, color=colour, markerfacecolor=face, markersize=4.2, markeredgewidth=0.9
    )


def _label_rows(axes: Axes, factors: Sequence[str], shown: Sequence[RowLevels]) -> None:
    """Label each block of policies, and shade every second block in all panels."""
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
            _row_level(factor, level)
            for factor, level in zip(factors[:-1], place, strict=True)
            if factor in AXES or level is not None
        )
        for place, _ in blocks
    ]
    axes.set_yticks([(ys[0] + ys[-1]) / 2 for _, ys in blocks], words)
    axes.tick_params(axis="y", labelcolor=style.INK)


def _row_level(factor: str, level: Any) -> str:
    """`high`, `6 m`, `tau_o 0.5`."""
    text = level_text(factor, level)
    return text if factor in AXES else f"{factor_text(factor)} {text}"


_MARK_SIZES_PT: Final = (3.4, 5.0, 6.6, 8.0, 9.2)  # Sizes of marks, from the lowest altitude up


@dataclass(frozen=True)
class Option:
    """One altitude and policy in one density, with its means."""

    altitude_m: Any
    policy: Any
    gain: Row
    cost: Row
    on_front: bool


def dominates(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """True if `one` is at least as good in gain (more is better) and cost (less is better), and better in one."""
    return one[0] >= other[0] and one[1] <= other[1] and one != other


def on_front(points: Sequence[tuple[float, float]]) -> list[bool]:
    """For each point, True if none dominates it (the Pareto front). Equal points are on the front together."""
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
        chosen = style.policy_styles(group.policies)
        figure, axes = lattice(1, len(traffics), 2.5)
        found = [options(group, traffic, gain, cost) for traffic in traffics]
        wide = canvas.spans_wide([option.cost["mean"] for cells in found for option in cells], _WIDE_COSTS)
        for traffic, cells, panel in zip(traffics, found, axes[0], strict=True):
            _front_panel(panel, group, cells, (gain, cost), chosen)
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(f"Mean {heading(cost)[:1].lower()}{heading(cost)[1:]}")
        if wide:
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        axes[0][0].set_ylabel(f"Mean {heading(gain)[:1].lower()}{heading(gain)[1:]}")
        policy_legend(
            figure, chosen, [*_size_legend(group), Line2D([], [], color=style.INK, linewidth=0.9, label="front")]
        )
    return figure


def _front_panel(
    axes: Axes, group: Group, cells: Sequence[Option], metrics: tuple[Metric, Metric], chosen: PolicyStyles
) -> None:
    gain, cost = metrics
    for option in cells:
        look, strong = chosen[option.policy], 1.0 if option.on_front else 0.4
        drawn: dict[str, Any] = {"color": look.colour, "linestyle": look.dash, "linewidth": 0.7, "alpha": 0.45 * strong}
        x, y = _interval_lines(axes, option, gain, cost, **drawn)
        axes.plot(
            x, y, look.marker, color=look.colour, markersize=_mark_size(group, option.altitude_m), alpha=strong,
            markeredgecolor=style.INK if option.on_front else style.PAPER, markeredgewidth=0.7, zorder=4,
        )  # fmt: skip
    # Steps: at a cost between two cells of the front, the cheaper one is the best there is.
    ends = sorted((o.cost["mean"] * cost.scale, o.gain["mean"] * gain.scale) for o in cells if o.on_front)
    if ends:
        axes.step([x for x, _ in ends], [y for _, y in ends], where="post", color=style.INK, linewidth=0.9, zorder=3)


def _size_legend(group: Group) -> list[Line2D]:
    if len(group.altitudes) < 2:
        return []
    look: dict[str, Any] = {"linestyle": "none", "marker": "o", "color": style.INK_FAINT}
    return [
        Line2D([], [], **look, markersize=_mark_size(group, altitude), label=level_text("altitude_m", altitude))
        for altitude in group.altitudes
    ]


def _mark_size(group: Group, altitude: Any) -> float:
    at = group.altitudes.index(altitude) if len(group.altitudes) > 1 else 1
    return _MARK_SIZES_PT[min(at, len(_MARK_SIZES_PT) - 1)]


_GOLDEN: Final = 0.6180339887498949
"""Multiples of it, modulo 1, are spread evenly: dots next to each other without a random number."""
_MANY_DOTS: Final = 1500  # More dots than this are drawn as one image, to keep the page small


def spread(group: Group, metric: Metric, traffics: Sequence[Any]) -> Figure:
    """A column a density; rows by altitude, and in it by policy."""
    with style.styled():
        chosen = style.policy_styles(group.policies)
        height = 0.3 + 0.155 * len(group.altitudes) * (len(group.policies) + 0.8)
        figure, axes = lattice(1, len(traffics), height)
        known = group.result.filter(pl.col(metric.name).is_not_null())
        positive = bool(known.height) and float(known[metric.name].min()) > 0.0  # type: ignore[arg-type]
        for traffic, panel in zip(traffics, axes[0], strict=True):
            _spread_panel(
                panel, group, metric, _at_level(known, "traffic", traffic), chosen, rasterized=known.height > _MANY_DOTS
            )
            canvas.panel_title(panel, traffic_title(traffic))
            panel.set_xlabel(heading(metric))
        if positive and metric.more_is_better is False:
            canvas.logarithmic(*(panel.xaxis for panel in axes[0]))
        policy_legend(figure, chosen)
    return figure


def _spread_panel(
    axes: Axes, group: Group, metric: Metric, known: pl.DataFrame, chosen: PolicyStyles, *, rasterized: bool
) -> None:
    block = len(group.policies) + 0.8
    for at, altitude in enumerate(group.altitudes):
        of_altitude = _at_level(known, "altitude_m", altitude)
        for below, policy in enumerate(group.policies):
            values = _at_level(of_altitude, "policy", policy)[metric.name].to_numpy().astype(np.float64) * metric.scale
            if len(values):
                _spread_row(axes, values, at * block + below, chosen[policy], rasterized=rasterized)
    middles = [at * block + (len(group.policies) - 1) / 2 for at in range(len(group.altitudes))]
    axes.set_yticks(middles, [level_text("altitude_m", altitude) for altitude in group.altitudes])
    axes.set_ylim(len(group.altitudes) * block - 0.9, -0.9)
    axes.tick_params(axis="y", length=0, labelcolor=style.INK)
    axes.grid(axis="y", visible=False)


def _spread_row(axes: Axes, values: Float64Array, y: float, look: style.PolicyStyle, *, rasterized: bool) -> None:
    colour = look.colour
    jitter = ((np.arange(len(values)) + 1) * _GOLDEN % 1.0 - 0.5) * 0.62
    axes.plot(
        values, y + jitter, ".", color=colour, markersize=3.6, markeredgewidth=0, alpha=0.6, rasterized=rasterized
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


def _at_level(frame: pl.DataFrame, column: str, level: Any) -> pl.DataFrame:
    """The rows of a level; all of them where the level stands for all."""
    return frame.filter(pl.col(column) == level) if level is not None else frame


_NO_FACTORS: Final = ("replicate", "residual")  # Terms that are not factors of the design
_MOST_TERMS: Final = 16


def effect_bars(effects: pl.DataFrame, metrics: Sequence[Metric]) -> Figure:
    """η² as bars, ω² as marks; terms in the order of the frame."""
    terms = effects["term"].unique(maintain_order=True).to_list()[:_MOST_TERMS]
    with style.styled():
        figure, panels = canvas.side_by_side(len(metrics), 0.85 + 0.2 * len(terms))
        shown = effects.filter(pl.col("term").is_in(terms)).select(pl.max_horizontal("eta2", "omega2").max()).item()
        widest = 132 * float(shown or 0.01)  # all panels have one scale, in per cent
        for axes, metric in zip(panels, metrics, strict=True):
            rows = effects.filter(pl.col(METRIC) == metric.name).iter_rows(named=True)
            _effect_panel(axes, metric, terms, {row["term"]: row for row in rows})
            axes.set_xlim(0, widest)
        panels[0].set_yticks(range(len(terms)), [term_text(term) for term in terms])
        panels[0].tick_params(axis="y", labelcolor=style.INK)
        figure.legend(handles=_effect_legend(), loc="outside upper left", ncols=4, borderaxespad=0.2)
    return figure


def _effect_panel(axes: Axes, metric: Metric, terms: Sequence[str], rows: dict[str, Row]) -> None:
    axes.grid(axis="y", visible=False)
    for y, term in enumerate(terms):
        row = rows.get(term)
        if row is None or row["eta2"] is None:
            continue
        share = 100 * row["eta2"]
        axes.barh(y, share, height=0.62, color=_effect_colour(term, row["p"]), linewidth=0)
        omega = 100 * max(row["omega2"], 0.0) if row["omega2"] is not None else None
        if omega is not None:
            axes.plot(omega, y, "D", markersize=3.2, markerfacecolor=style.PAPER, markeredgecolor=style.INK, zorder=4)
        text = number(share, 1) if omega is None else f"{number(share, 1)} ({number(omega, 0)})"
        axes.annotate(
            text, (max(share, omega or 0.0), y), xytext=(4, 0), textcoords="offset points",
            va="center_baseline", fontsize=6,
        )  # fmt: skip
    axes.set(ylim=(len(terms) - 0.4, -0.6), xlabel="share of variation, %")
    axes.tick_params(axis="y", length=0)
    canvas.panel_title(axes, metric.label)


def _effect_colour(term: str, p: float | None) -> str:
    if term in _NO_FACTORS:
        return style.INK_FAINT
    return style.BASE if p is not None and p < ALPHA else _UNSURE


_UNSURE: Final = "#B8C6D9"


def _effect_legend() -> list[Patch | Line2D]:
    diamond = Line2D(
        [], [], linestyle="none", marker="D", markersize=3.4, markerfacecolor=style.PAPER,
        markeredgecolor=style.INK, label="partial ω², in brackets",
    )  # fmt: skip
    return [
        Patch(color=style.BASE, label=f"η², p < {ALPHA:g} uncorrected"),
        Patch(color=_UNSURE, label=f"η², p ≥ {ALPHA:g}"),
        Patch(color=style.INK_FAINT, label="η², not a factor of the design"),
        diamond,
    ]


def lattice(
    rows: int, columns: int, row_in: float, share_y: Literal["row", "all"] = "row"
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of the text width with axes in rows and columns, narrower when there is one column.

    All panels share x, those of a row y, since a reader compares along it; all share y where they show one metric.
    """
    width = canvas.WIDTH_IN if columns > 1 else 0.62 * canvas.WIDTH_IN
    figure = style.new_figure(width, 0.55 + row_in * rows)
    figure.set_layout_engine("constrained", h_pad=0.05, w_pad=0.04)
    axes = figure.subplots(rows, columns, squeeze=False, sharex="all", sharey=share_y)
    return figure, [list(row) for row in axes]


def policy_legend(
    figure: Figure, chosen: PolicyStyles, more: Sequence[Line2D] = (), drawn: Collection[str] | None = None
) -> None:
    """Legend above the panels, in one line if the figure is wide enough; none if there is nothing to distinguish.

    Args:
        drawn: those of the policies that are in the figure; all unless given.
    """
    marks = [
        Line2D(
            [], [], color=look.colour, marker=look.marker, linestyle=look.dash, markersize=4.5, linewidth=1.0,
            label=level_text("policy", policy),
        )
        for policy, look in chosen.items()
        if drawn is None or policy in drawn
    ]  # fmt: skip
    handles = [*(marks if len(chosen) > 1 else []), *more]
    for columns in range(min(len(handles), 9), 0, -1):
        legend = figure.legend(
            handles=handles, loc="outside upper left", ncols=columns, borderaxespad=0.2, columnspacing=1.4,
            handlelength=1.7,
        )  # fmt: skip
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()
