"""The sizes of all effects in one picture: on the same flight, and on the decision."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import polars as pl
from matplotlib.axes import Axes

from benchmarks.effects.catalogue import Kind
from benchmarks.effects.sizes import Effect, option_text, ranked
from benchmarks.effects.table import RELATIVE
from pavetwin.draw import style
from pavetwin.experiments.metrics import metric_named

COLOURS: Final = {
    Kind.LEFT_OUT: "#C2571A",
    Kind.CONDITION: "#1F6FB2",
    Kind.ASSUMPTION: "#5B8A3A",
    Kind.CHANCE: "#8A847C",
}
WORDS: Final = {
    Kind.LEFT_OUT: "the twin without it",
    Kind.CONDITION: "another day",
    Kind.ASSUMPTION: "another assumption or choice",
    Kind.CHANCE: "chance: another seed",
}
PANELS: Final = (
    ("coverage", "Defects found,\npercentage points"),
    ("surface_coverage", "Surface seen,\npercentage points"),
    ("time_s", "Time,\n%"),
    ("energy", "Battery,\n%"),
)
ROW_IN: Final = 0.2


def save_plot(found: Sequence[Effect], path: Path) -> None:
    """A row an effect over all worlds, by kind and then the largest first: dots with simultaneous 95 % intervals."""
    effects = sorted(ranked(found), key=lambda effect: list(Kind).index(effect.variant.kind))
    height = ROW_IN * len(effects)
    with style.styled():
        figure = style.new_figure(11.9, height + 1.2)
        left = 3.3
        for name, title in PANELS:
            axes = style.axes_in(figure, left, 0.55, 1.35, height)
            _panel(axes, [effect.flight for effect in effects], effects, name, title)
            if left == 3.3:
                axes.set_yticks(range(len(effects)), [_plain(effect.variant.title) for effect in effects])
            left += 1.52
        axes = style.axes_in(figure, left + 0.1, 0.55, 1.35, height)
        _panel(
            axes,
            [effect.decision for effect in effects],
            effects,
            "coverage",
            "Lost by deciding without\nknowing, points",
        )
        for at, effect in enumerate(effects):
            text = option_text(effect.options[1]) if effect.decision is not None else "same proposal"
            colour = style.INK if effect.decision is not None else style.INK_FAINT
            axes.annotate(text, (1.04, at), xycoords=("axes fraction", "data"), va="center", fontsize=6.5, color=colour)
        for word, colour in legend(effects).items():
            axes.plot([], [], "o", color=colour, markersize=4, label=word)
        handles = axes.get_legend_handles_labels()
        figure.legend(*handles, loc="lower left", bbox_to_anchor=(0.01, 0.0), ncols=2)
        style.save_figure(figure, path)


def legend(found: Sequence[Effect]) -> dict[str, str]:
    """The colours of the kinds that there are, by their words."""
    return {WORDS[kind]: COLOURS[kind] for kind in Kind if any(effect.variant.kind is kind for effect in found)}


def _panel(axes: Axes, frames: Sequence[pl.DataFrame | None], effects: Sequence[Effect], name: str, title: str) -> None:
    for at, (frame, effect) in enumerate(zip(frames, effects, strict=True)):
        row = None if frame is None else frame.row(by_predicate=pl.col("metric") == name, named=True)
        if row is None or row["mean"] is None:
            continue
        metric, colour = metric_named(name), COLOURS[effect.variant.kind]
        scale = 100 / row["before"] if metric in RELATIVE and row["before"] else metric.scale
        if row["low"] is not None and row["high"] is not None:
            axes.plot([scale * row["low"], scale * row["high"]], [at, at], color=colour, linewidth=1.2)
        axes.plot([scale * row["mean"]], [at], "o", color=colour, markersize=3.6)
    axes.axvline(0, color=style.INK_SOFT, linewidth=0.6)
    axes.set_title(title, fontsize=7, fontweight="normal")
    axes.set(ylim=(len(effects) - 0.4, -0.6), yticks=[])
    axes.grid(visible=False, axis="y")


def _plain(title: str) -> str:
    """Without Markdown's marks."""
    return title.replace("*", "")
