"""`python -m gallery.training`: the curves of the trainings whose weights ship, from `recipes/runs`."""

import argparse
from pathlib import Path
from typing import Final

import matplotlib.pyplot as plt
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from pavetwin.perception.classes import CLASSES
from pavetwin.perception.shipped import shipped_models

COLOURS: Final = ("#1F6FB2", "#C4572E", "#3A8C5F", "#B58900", "#7A4FA3")
RUNS: Final = Path("recipes/runs")
PARTS: Final = {"box": 7.5, "classes": 0.5, "distribution": 1.5, "subtype": 1.0, "mask": 1.0}
"""Parts of the loss and their weights in it, see docs/explanation/detector.md."""

BEFORE: Final = {
    "synthetic-11": ("synthetic-9", "synthetic-10"),
    "synthetic-12": ("synthetic-9", "synthetic-10", "synthetic-11", "synthetic-12-first"),
}
"""Short trainings that one went on from: their epochs are drawn before its own."""


def model_panels(losses: Axes, precisions: Axes, name: str, runs: list[pl.DataFrame]) -> None:
    """Weighted parts of the loss, and the average precision on the validation images, over the detector's epochs; a
    line for each run of a mean."""
    for first, curves in zip([True, *[False] * (len(runs) - 1)], runs, strict=True):
        detector = curves.filter(~pl.col("phase").str.contains("classifier"))
        epochs = range(1, len(detector) + 1)
        for colour, (part, weight) in zip(COLOURS, PARTS.items(), strict=True):
            losses.plot(epochs, weight * detector[part], ".-", color=colour, lw=1.1, label=part if first else None)
        for colour, kind in zip(COLOURS, CLASSES, strict=True):
            precisions.plot(epochs, 100 * detector[kind], ".-", color=colour, lw=1.1, label=kind if first else None)
        precisions.plot(epochs, 100 * detector["map50"], ".-", color="black", lw=2.2, label="mean" if first else None)
    losses.set(title=f"{name}: parts of the loss, weighted", xlabel="epoch", ylim=(0, None))
    precisions.set(title=f"{name}: validation images, AP@0.5, %", xlabel="epoch", ylim=(0, 100))
    for axes in (losses, precisions):
        axes.title.set_size(10)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.spines[["top", "right"]].set_visible(False)


def runs_of(name: str) -> list[pl.DataFrame]:
    """The curves of a training's runs."""
    return [pl.read_csv(file) for file in sorted((RUNS / name).rglob("curves.csv"))]


def main() -> None:
    """Draw one row for each model; what ships may be the mean of several runs."""
    parser = argparse.ArgumentParser(prog="python -m gallery.training", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/images/training.png"))
    output = parser.parse_args().output
    names = sorted(shipped_models(), key=lambda name: (name.startswith("mixed"), len(name), name))
    figure, rows = plt.subplots(len(names), 2, figsize=(11, 3.4 * len(names)), squeeze=False, layout="constrained")
    for (losses, precisions), name in zip(rows, names, strict=True):
        runs, title = runs_of(name), name
        if len(runs) > 1:
            title += f" ({len(runs)} runs)"
        elif name in BEFORE:
            before = [curves for each in BEFORE[name] for curves in runs_of(each)]
            runs, title = [pl.concat([*before, *runs])], f"{name}, from {BEFORE[name][0]} on"
        model_panels(losses, precisions, title, runs)
    for axes in rows[0]:
        handles, labels = axes.get_legend_handles_labels()
        axes.legend(handles, labels, ncols=3, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.1), frameon=False)
    figure.savefig(output, dpi=110)
    print(output)


if __name__ == "__main__":
    main()
