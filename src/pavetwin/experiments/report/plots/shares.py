"""Which factor explains how much: a bar a term, a panel a metric."""

from collections.abc import Sequence
from typing import Final

import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pavetwin.draw import style
from pavetwin.experiments.metrics import Metric
from pavetwin.experiments.report import canvas
from pavetwin.experiments.report.study import METRIC, Row
from pavetwin.experiments.statistics.simultaneous import ALPHA
from pavetwin.experiments.words import number, term_text

_BLOCKS: Final = ("replicate", "residual")
"""Terms that are not factors of the design."""


def effect_bars(effects: pl.DataFrame, metrics: Sequence[Metric], most: int = 16) -> Figure:
    """η² as bars, ω² as marks; terms in the order of the frame, at most so many."""
    terms = effects["term"].unique(maintain_order=True).to_list()[:most]
    with style.styled():
        figure, panels = canvas.beside_each_other(len(metrics), 0.85 + 0.2 * len(terms))
        widest = 1.32 * _widest(effects, terms)
        for axes, metric in zip(panels, metrics, strict=True):
            rows = effects.filter(pl.col(METRIC) == metric.name).iter_rows(named=True)
            _panel(axes, metric, terms, {row["term"]: row for row in rows})
            axes.set_xlim(0, widest)
        panels[0].set_yticks(range(len(terms)), [term_text(term) for term in terms])
        panels[0].tick_params(axis="y", labelcolor=style.INK)
        figure.legend(handles=_key(), loc="outside upper left", ncols=4, borderaxespad=0.2)
    return figure


def _panel(axes: Axes, metric: Metric, terms: Sequence[str], rows: dict[str, Row]) -> None:
    axes.grid(axis="y", visible=False)
    for y, term in enumerate(terms):
        row = rows.get(term)
        if row is None or row["eta2"] is None:
            continue
        share = 100 * row["eta2"]
        axes.barh(y, share, height=0.62, color=_colour(term, row["p"]), linewidth=0)
        omega = 100 * max(row["omega2"], 0.0) if row["omega2"] is not None else None
        if omega is not None:
            axes.plot(omega, y, "D", markersize=3.2, markerfacecolor=style.PAPER, markeredgecolor=style.INK, zorder=4)
        told = number(share, 1) if omega is None else f"{number(share, 1)} ({number(omega, 0)})"
        axes.annotate(
            told, (max(share, omega or 0.0), y), xytext=(4, 0), textcoords="offset points",
            va="center_baseline", fontsize=6,
        )  # fmt: skip
    axes.set(ylim=(len(terms) - 0.4, -0.6), xlabel="share of variation, %")
    axes.tick_params(axis="y", length=0)
    canvas.panel_title(axes, metric.label)


def _widest(effects: pl.DataFrame, terms: Sequence[str]) -> float:
    """The largest share of any panel, so that all have one scale; in per cent."""
    shown = effects.filter(pl.col("term").is_in(terms)).select(pl.max_horizontal("eta2", "omega2").max()).item()
    return 100 * float(shown or 0.01)


def _colour(term: str, p: float | None) -> str:
    if term in _BLOCKS:
        return style.INK_FAINT
    return style.BASE if p is not None and p < ALPHA else _UNSURE


_UNSURE: Final = "#B8C6D9"


def _key() -> list[Patch | Line2D]:
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
