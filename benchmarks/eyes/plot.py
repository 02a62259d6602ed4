"""Figures of the fitted sensor and the detector, and of the results of the study by sensor."""

from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from pavetwin.draw import style

MARKERS: Final = {"low": "o", "medium": "s", "high": "^"}
COLOURS: Final = {"recall": "#8A847C", "calibrated": "#1F6FB2", "detector": "#C2571A"}


def save_agreement(cells: pl.DataFrame, path: Path) -> None:
    """Coverage that the fitted sensor predicts over that of the detector, a mark a cell; bars are 1.96 deviations of
    the prediction."""
    with style.styled():
        figure = style.new_figure(4.2, 4.0)
        figure.set_layout_engine("constrained")
        axes = figure.subplots()
        axes.plot([0, 100], [0, 100], color=style.INK_FAINT, linewidth=1)
        altitudes = sorted(cells["altitude_m"].unique().to_list())
        for altitude_m, colour in zip(altitudes, ("#1F3A5F", "#1F6FB2", "#C2571A"), strict=False):
            for density, marker in MARKERS.items():
                mine = cells.filter(altitude_m=altitude_m, traffic=density)
                if mine.height:
                    axes.errorbar(
                        100 * mine["detector"].to_numpy(),
                        100 * mine["calibrated"].to_numpy(),
                        yerr=196 * mine["deviation"].to_numpy(),
                        fmt=marker, markersize=5, color=colour, elinewidth=0.8, label=f"{altitude_m:g} m, {density}",
                    )  # fmt: skip
        axes.set(xlim=(0, 100), ylim=(0, 100), xlabel="detector: defects found, %", ylabel="fitted sensor: expected, %")
        axes.legend(loc="upper left", fontsize=7.5)
    style.save_figure(figure, path)


def save_answers(table: pl.DataFrame, path: Path) -> None:
    """Mean coverage, and mean error of the condition index, over altitude: a line a sensor, with 95 % intervals.

    Args:
        table: `sensor`, `altitude_m`, and of `coverage` and `pci_error` the mean, `…_low` and `…_high`.
    """
    with style.styled():
        figure = style.new_figure(6.6, 3.1)
        figure.set_layout_engine("constrained")
        panels = (("coverage", "defects found, %", 100.0), ("pci_error", "condition index too high by, points", 1.0))
        for axes, (name, label, scale) in zip(figure.subplots(1, 2), panels, strict=True):
            for shift, (sensor, colour) in enumerate(COLOURS.items()):
                mine = table.filter(sensor=sensor).drop_nulls(name).sort("altitude_m")
                if not mine.height:
                    continue
                middle = scale * mine[name].to_numpy()
                ends = [scale * mine[f"{name}_{end}"].to_numpy() for end in ("low", "high")]
                axes.errorbar(
                    mine["altitude_m"].to_numpy() + 0.12 * (shift - 1), middle,
                    yerr=np.abs(np.stack(ends) - middle), fmt="o-", markersize=4, color=colour, elinewidth=1,
                    label=sensor,
                )  # fmt: skip
            axes.set(xlabel="altitude, m", ylabel=label, ylim=(0, 100 if scale > 1 else None))
            axes.set_xticks(sorted(table["altitude_m"].unique().to_list()))
        figure.axes[0].legend(loc="lower left", fontsize=7.5)
    style.save_figure(figure, path)
