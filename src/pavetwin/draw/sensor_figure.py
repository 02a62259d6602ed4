"""A fitted sensor against observed detections: a reliability diagram, and how often repeated looks find a defect."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, PercentFormatter

from pavetwin.draw import style
from pavetwin.sensing.fit.fitting import reliability, repeated_looks
from pavetwin.sensing.fit.look_tables import GROUP, LookSource
from pavetwin.sensing.fitted_sensor import SensorModel

ENOUGH: Final = 30  # Defects with as many looks, to show how many of these found them
MOST_LOOKS: Final = 10  # More looks at one defect than that do not fit the figure
_PERCENT: Final = PercentFormatter(1.0, decimals=0, symbol=" %")


def save_sensor_figure(model: SensorModel, sources: Sequence[LookSource], path: Path, *, are_others: bool) -> None:
    """Draw and write the figure.

    Args:
        sources: what to compare with.
        are_others: whether the model was not fitted to them.

    Raises:
        PaveTwinError: the file cannot be written.
    """
    looks = pl.concat([each.looks for each in sources])
    with style.styled():
        figure = style.new_figure(6.6, 3.3)
        figure.set_layout_engine("constrained")
        left, right = figure.subplots(1, 2)
        _chances(left, model, looks)
        _repeats(right, model, looks)
        what = "not used to fit it" if are_others else "that it was fitted to"
        figure.suptitle(f"Fitted sensor and {len(looks)} looks {what}", fontsize=9)
    style.save_figure(figure, path)


def _chances(axes: Axes, model: SensorModel, looks: pl.DataFrame) -> None:
    """Each dot a tenth of the looks; bars are two standard errors."""
    seen = reliability(model, looks)
    axes.plot([0, 1], [0, 1], color=style.INK_FAINT, linewidth=1)
    errors = np.minimum(2 * seen.standard_error, np.stack([seen.observed, 1 - seen.observed]))
    axes.errorbar(
        seen.predicted,
        seen.observed,
        yerr=errors,
        fmt="o",
        markersize=4,
        color=style.POLICY_COLOURS["hover"],
        elinewidth=1,
        clip_on=False,
        zorder=3,
    )
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="chance that the model gives", ylabel="looks that found their defect")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(_PERCENT)
    axes.set_title("Single looks, in tenths", fontsize=8.5)


def most_repeated(looks: pl.DataFrame) -> int:
    """The most looks, from 2 to `MOST_LOOKS`, that at least `ENOUGH` defects have; 2 where fewer have two."""
    often = looks.group_by(GROUP).len()["len"]
    return max((many for many in range(2, MOST_LOOKS + 1) if (often >= many).sum() >= ENOUGH), default=2)


def _repeats(axes: Axes, model: SensorModel, looks: pl.DataFrame) -> None:
    count = most_repeated(looks)
    seen = repeated_looks(model, looks, count)
    total = seen.observed.sum()
    if not total:
        axes.text(0.5, 0.5, "no defect has two looks", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    places = np.arange(count + 1)
    axes.bar(places, seen.observed / total, width=0.6, color=style.BUILDING, label="observed")
    for expected, line, policy, label in (
        (seen.fitted, "o-", "hover", "fitted model"),
        (seen.independent, "^--", "micro", "each look by itself"),
    ):
        axes.plot(places, expected / total, line, markersize=5, color=style.POLICY_COLOURS[policy], label=label)
    axes.set(xlabel=f"looks of {count} that found it", ylabel=f"share of {total:.0f} defects", ylim=(0, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(_PERCENT)
    axes.legend(loc="upper left", fontsize=7.5)
    axes.set_title("Repeated looks at one defect", fontsize=8.5)
