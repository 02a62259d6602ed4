"""Figures that go into the page as they are: vector drawings or small pictures inside data URIs."""

from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Literal

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from pavetwin.draw import style
from pavetwin.experiments.report.parts import Picture
from pavetwin.experiments.report.slim import slim
from pavetwin.experiments.report.words import level_text

Floats = npt.NDArray[np.float64]
Looks = Mapping[Any, tuple[str, str]]
"""Colour and marker of each policy."""

WIDTH_IN: Final = 7.0
"""The text width of a page of A4."""

_CSS_PX_PER_IN: Final = 96


def vector(figure: Figure, caption: str, alt: str) -> Picture:
    """The figure as SVG, its letters as outlines: it looks the same where DejaVu Sans is not installed."""
    text = StringIO()
    with style.styled():
        matplotlib.rcParams["svg.hashsalt"] = "pavetwin"
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return _picture(figure, caption, alt, slim(text.getvalue()).encode(), "svg")


def raster(figure: Figure, caption: str, alt: str) -> Picture:
    """The figure as PNG of few colours: for maps, which hold more shapes than a page should."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "figure.png"
        style.save_figure(figure, path)
        content = path.read_bytes()
    return _picture(figure, caption, alt, content, "png")


def _picture(figure: Figure, caption: str, alt: str, content: bytes, suffix: str) -> Picture:
    width, height = (round(float(side) * _CSS_PX_PER_IN) for side in figure.get_size_inches())
    return Picture(caption, alt, content, suffix, width, height)


def looks(policies: Sequence[Any]) -> Looks:
    """The house colours and markers; policies of the user's take the spare ones in turn."""
    own = [policy for policy in policies if policy not in style.POLICY_COLOURS]
    return {policy: style.policy_style(policy, own.index(policy) if policy in own else 0) for policy in policies}


def lattice(
    rows: int, columns: int, row_in: float, share_y: Literal["row", "all"] = "row"
) -> tuple[Figure, list[list[Axes]]]:
    """A figure of the text width with axes in rows and columns, narrower when there is one column.

    All panels share x, those of a row y, since a reader compares along it; all share y where they show one metric.
    """
    width = WIDTH_IN if columns > 1 else 0.62 * WIDTH_IN
    figure = style.new_figure(width, 0.55 + row_in * rows)
    figure.set_layout_engine("constrained", h_pad=0.05, w_pad=0.04)
    axes = figure.subplots(rows, columns, squeeze=False, sharex="all", sharey=share_y)
    return figure, [list(row) for row in axes]


def policy_legend(figure: Figure, chosen: Looks, more: Sequence[Line2D] = ()) -> None:
    """One line above the panels. Nothing when there is nothing to tell apart."""
    marks = [
        Line2D([], [], color=colour, marker=marker, markersize=4.5, linewidth=1.0, label=level_text("policy", policy))
        for policy, (colour, marker) in chosen.items()
    ]
    handles = [*(marks if len(marks) > 1 else []), *more]
    if handles:
        figure.legend(
            handles=handles, loc="outside upper left", ncols=min(len(handles), 9), borderaxespad=0.2,
            columnspacing=1.4, handlelength=1.7,
        )  # fmt: skip


def panel_title(axes: Axes, words: str) -> None:
    axes.set_title(words, fontsize=7.8, color=style.INK, pad=4)


def spans_wide(values: Sequence[float], ratio: float = 8.0) -> bool:
    """Whether these are better seen on a logarithmic axis: all above 0, the largest above `ratio` times the least."""
    return bool(values) and min(values) > 0 and max(values) / min(values) > ratio


def logarithmic(axis: Axis) -> None:
    """A logarithmic axis whose ticks read 10, 20, 50, 100 …, and some between where it is short."""
    low, high = axis.get_data_interval()
    subs = (1.0, 2.0, 5.0) if high > 8 * low else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
    getattr(axis.axes, f"set_{axis.axis_name}scale")("log")  # type: ignore[attr-defined]
    axis.set_major_locator(LogLocator(base=10, subs=subs, numticks=20))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
