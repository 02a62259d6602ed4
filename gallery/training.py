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


def run_panels(losses: Axes, precisions: Axes, name: str, curves: pl.DataFrame) -> None:
    """Weighted parts of the loss, and the average precision on the validation images, over the detector's epochs."""
    detector = curves.filter(~pl.col("phase").str.contains("classifier"))
    epochs = range(1, len(detector) + 1)
    for colour, (part, weight) in zip(COLOURS, PARTS.items(), strict=True):
        losses.plot(epochs, weight * detector[part], color=colour, label=part)
    for colour, kind in zip(COLOURS, CLASSES, strict=True):
        precisions.plot(epochs, 100 * detector[kind], color=colour, lw=1.1, label=kind)
    precisions.plot(epochs, 100 * detector["map50"], color="black", lw=2.2, label="mean")
    losses.set(title=f"{name}: parts of the loss, weighted", xlabel="epoch", ylim=(0, None))
    precisions.set(title="AP@0.5 on the validation images, per cent", xlabel="epoch", ylim=(0, 100))
    for axes in (losses, precisions):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def main() -> None:
    """Draw one row for each run; what ships may be the mean of several."""
    parser = argparse.ArgumentParser(prog="python -m gallery.training", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/images/training.png"))
    output = parser.parse_args().output
    runs = [file for name in shipped_models() for file in sorted((RUNS / name).rglob("curves.csv"))]
    figure, rows = plt.subplots(len(runs), 2, figsize=(11, 3.4 * len(runs)), squeeze=False, layout="constrained")
    for (losses, precisions), file in zip(rows, runs, strict=True):
        run_panels(losses, precisions, " ".join(file.parent.relative_to(RUNS).parts), pl.read_csv(file))
    figure.savefig(output, dpi=110)
    print(output)


if __name__ == "__main__":
    main()
