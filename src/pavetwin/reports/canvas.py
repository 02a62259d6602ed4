"""Figures embedded in the page: vector drawings or small images inside data URIs."""

import re
from collections.abc import Sequence
from math import ceil, floor, log10
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, Locator, NullLocator

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.reports.blocks import ReportFigure

WIDTH_IN: Final = 7.0
"""The text width of a page of A4."""

_CSS_PX_PER_IN: Final = 96


def vector(figure: Figure, caption: str, alt: str) -> ReportFigure:
    """The figure as SVG, with text as outlines, so that it looks the same without DejaVu Sans."""
    return _embedded(figure, caption, alt, "svg")


def raster(figure: Figure, caption: str, alt: str) -> ReportFigure:
    """The figure as PNG of few colours, for maps, which have too many shapes for a page."""
    return _embedded(figure, caption, alt, "png")


def _embedded(figure: Figure, caption: str, alt: str, suffix: Literal["svg", "png"]) -> ReportFigure:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"figure.{suffix}"
        style.save_figure(figure, path)
        content = slim(path.read_text(encoding="utf-8")).encode() if suffix == "svg" else path.read_bytes()
    width, height = (round(float(side) * _CSS_PX_PER_IN) for side in figure.get_size_inches())
    return ReportFigure(caption, alt, content, suffix, width, height)


def slim(svg: str) -> str:
    """Matplotlib's SVG as one line, without comments; coordinates keep hundredths of a point.

    Scales of glyphs are small numbers and keep all their digits.
    """
    body = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    body = re.sub(r">\s+<", "><", re.sub(r"\s*\n\s*", " ", body)).strip()
    return re.sub(
        r"scale\([^)]*\)|-?\d+\.\d{3,}",
        lambda found: found[0] if found[0].startswith("scale") else f"{float(found[0]):.2f}".rstrip("0").rstrip("."),
        body,
    )


def side_by_side(panels: int, height_in: float) -> tuple[Figure, Sequence[Axes]]:
    """A figure of the text width with panels that share their rows."""
    figure = style.new_figure(WIDTH_IN, height_in)
    figure.set_layout_engine("constrained", w_pad=0.03)
    return figure, figure.subplots(1, panels, squeeze=False, sharey=True)[0]


def panel_title(axes: Axes, words: str) -> None:
    axes.set_title(words, fontsize=7.8, color=style.INK, pad=4)


def spans_wide(values: Sequence[float], ratio: float = 8.0) -> bool:
    """True if values suit a logarithmic axis: all above 0, the largest above `ratio` times the least."""
    return bool(values) and min(values) > 0 and max(values) / min(values) > ratio


def logarithmic(axis: Axis, *alike: Axis) -> None:
    """A logarithmic axis whose ticks read 10, 20, 50, 100 …: as many of them as fit.

    Its label and those of the axes `alike` that share it state the scale; set labels before.
    """
    for labelled in (axis, *alike):
        labelled.set_label_text(f"{labelled.get_label_text()}\n(log scale)".strip())
    getattr(axis.axes, f"set_{axis.axis_name}scale")("log")  # type: ignore[attr-defined]
    axis.set_major_locator(_SpacedLogLocator(axis))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


class _SpacedLogLocator(Locator):
    """Round numbers on a logarithmic axis: as many as fit without overlapping labels."""

    _STEPS: Final = ((1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8), (1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,))
    """Within a decade."""
    _TICK_PT: Final = 7.5
    _BETWEEN_PT: Final = 6.0

    def __init__(self, axis: Axis) -> None:
        self._of = axis

    def __call__(self) -> list[float]:
        low, high = sorted(self._of.get_view_interval())
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        decades = 10.0 ** np.arange(floor(log10(vmin)), ceil(log10(vmax)) + 1)
        found = np.empty(0)
        for steps in self._STEPS:
            found = np.outer(decades, steps).ravel()
            found = found[(found >= vmin * (1 - 1e-9)) & (found <= vmax * (1 + 1e-9))]
            if self._clear(found, log10(vmax / vmin)):
                break
        return found.tolist()

    def _clear(self, values: Float64Array, decades: float) -> bool:
        """True if the labels of all ticks fit without overlap."""
        flat, box = self._of is self._of.axes.xaxis, self._of.axes.get_window_extent()
        length_pt = (box.width if flat else box.height) * 72 / self._of.axes.figure.dpi
        widths = [style.text_width_pt(f"{value:g}", self._TICK_PT) if flat else self._TICK_PT for value in values]
        sizes, gaps = np.array(widths), np.diff(np.log10(values)) * length_pt / decades
        return bool((gaps >= (sizes[1:] + sizes[:-1]) / 2 + self._BETWEEN_PT).all())
