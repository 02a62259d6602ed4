"""Common style of every map and plot: colours, type, scale bar, north arrow, attribution, reproducible files.

Colours can be distinguished with the common forms of colour blindness; marks that must be distinguished also differ in
shape, for grey print. `pavetwin.draw.fonts` selects the fonts.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, Final, NamedTuple

import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Affine2D
from matplotlib.typing import ColorType
from PIL import Image

from pavetwin.arrays import UInt8Array
from pavetwin.draw.fonts import USUAL, choose_fonts, font_properties, readable
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.world.ground import Bounds

PAPER, INK, INK_SOFT, INK_FAINT = "#FFFFFF", "#2B2B2B", "#6E6A64", "#B5AFA6"
GROUND, PARK, PARK_EDGE = "#F4F1EB", "#DDE9CF", "#C3D6B0"
TREE, TREE_EDGE = "#A6C795", "#8DB27B"
BUILDING, BUILDING_LOW, BUILDING_HIGH, BUILDING_EDGE, SHADOW = "#D6CABC", "#E3DACE", "#B9AA9A", "#A99C8D", "#8D857B"
SIDEWALK, SIDEWALK_EDGE = "#E6E1D9", "#D3CCC2"
CARRIAGEWAY, CASING, MARKING, ZEBRA = "#FFFFFF", "#A8A199", "#B9B4AC", "#C4BFB7"
LAMP, SIGNAL, POLE, SIGN = "#D9A400", "#C0392B", "#8B857D", "#6C7A89"
BASE = "#1F3A5F"

POLICY_COLOURS: Mapping[str, str] = {"baseline": "#6B6B6B", "hover": "#0072B2", "micro": "#E08A00", "skip": "#009E73"}
POLICY_MARKERS: Mapping[str, str] = {"baseline": "o", "hover": "s", "micro": "^", "skip": "D"}
_MORE_COLOURS = (
    "#CC79A7", "#56B4E9", "#8C510A", "#332288", "#B22222", "#7FBF3F", "#D58BFF", "#00D0C0", "#C7A500", "#FF6F91",
)  # fmt: skip
"""Okabe and Ito's colours first, then those most distinct in the common forms of colour blindness."""
_MORE_MARKERS = ("v", "P", "X", "h", "*", "<", ">", "p", "d", "8")
_DASHES: Final = ((0, ()), (0, (4, 1.4)), (0, (1.2, 1.2)))
"""Dashes of the built-in policies and the first four others, of the next three, and of the rest."""

DEFECT_COLOURS: Mapping[str, str] = {"single_crack": "#3B6FB6", "crocodile_crack": "#D1495B", "pothole": "#262626"}
DEFECT_MARKERS: Mapping[str, str] = {"single_crack": "_", "crocodile_crack": "s", "pothole": "o"}


def defect_styles(found: Iterable[str]) -> list[tuple[str, str, str]]:
    """Class, colour and marker of the known classes and, after them, of the others among `found` by name."""
    more = sorted(set(found) - set(DEFECT_COLOURS))
    styles = [(kind, colour, DEFECT_MARKERS[kind]) for kind, colour in DEFECT_COLOURS.items()]
    return styles + [
        (kind, _MORE_COLOURS[at % len(_MORE_COLOURS)], _MORE_MARKERS[at % len(_MORE_MARKERS)])
        for at, kind in enumerate(more)
    ]


OUTCOME_COLOURS: Mapping[str, str] = {
    **{"found": "#00846B", "missed": "#D55E00", "found on return": "#0063B1"},
    "behind parked vehicle": "#6E6A66",
}
OUTCOME_MARKERS: Mapping[str, str] = {
    **{"found": "o", "missed": "X", "found on return": "D"},
    "behind parked vehicle": "X",
}

VISIBILITY = LinearSegmentedColormap.from_list(
    "visibility", [(0.0, "#7F1734"), (0.4, "#D8593B"), (0.7, "#F0B64A"), (0.85, "#6FB1C9"), (1.0, "#1F6FB2")]
)
"""o_{s,t} from 0 (all hidden: dark red) to 1 (all seen: blue); the usual threshold 0.7 is where yellow turns."""

DPI = 180

_SETTINGS: Mapping[Any, Any] = {
    "font.family": [USUAL],
    "font.size": 7.5,
    "text.color": INK,
    "axes.edgecolor": INK_SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E5E2DC",
    "grid.linewidth": 0.5,
    "xtick.color": INK_SOFT,
    "ytick.color": INK_SOFT,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 7,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
}


@contextmanager
def styled() -> Iterator[None]:
    """Context manager for drawing: ignores the user's matplotlibrc and restores its settings afterwards."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_SETTINGS)
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure that opens no window and needs no display. Sizes in inches."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def axes_in(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes of a figure by their box in inches."""
    page_w, page_h = figure.get_size_inches()
    return figure.add_axes((left / page_w, bottom / page_h, width / page_w, height / page_h))


def panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes without a frame whose coordinates are inches from their lower left corner."""
    axes = axes_in(figure, left, bottom, width, height)
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    return axes


class PolicyStyle(NamedTuple):
    colour: str
    marker: str
    dash: tuple[int, tuple[float, ...]]


def policy_style(name: str, order: int = 0) -> PolicyStyle:
    """How a policy is drawn; one that is not built in takes the `order`-th of ten spare styles."""
    if name in POLICY_COLOURS:
        return PolicyStyle(POLICY_COLOURS[name], POLICY_MARKERS[name], _DASHES[0])
    spare = order % len(_MORE_COLOURS)
    return PolicyStyle(_MORE_COLOURS[spare], _MORE_MARKERS[spare], _DASHES[(spare >= 4) + (spare >= 7)])


def policy_styles(policies: Sequence[str]) -> dict[str, PolicyStyle]:
    """How policies that are shown together are drawn; the user's own take the spare styles in turn."""
    own = [policy for policy in policies if policy not in POLICY_COLOURS]
    return {policy: policy_style(policy, own.index(policy) if policy in own else 0) for policy in policies}


def halo(width_pt: float = 1.6) -> list[patheffects.AbstractPathEffect]:
    """A rim around text or lines that keeps them readable over the map; its width in points."""
    return [patheffects.withStroke(linewidth=width_pt, foreground=PAPER)]


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """One line of a legend: a patch, a line, or any of Matplotlib's markers, and what it means."""

    label: str
    symbol: str
    """`patch`, `line`, or a marker."""
    colour: ColorType
    edge: ColorType = "none"
    size_pt: float = 5.0

    @property
    def handle(self) -> Patch | Line2D:
        if self.symbol == "patch":
            return Patch(facecolor=self.colour, edgecolor=self.edge, linewidth=0.6, label=self.label)
        options: dict[str, Any] = {"linewidth": self.size_pt}
        if self.symbol != "line":
            edge = self.colour if self.edge == "none" else self.edge
            options = {"linestyle": "", "marker": self.symbol, "markersize": self.size_pt, "markeredgecolor": edge}
        return Line2D([], [], color=self.colour, label=self.label, **options)


@dataclass(frozen=True)
class MapFigure:
    """A map in its frame, a title above, and a strip below for legend, scale bar, north arrow and sources."""

    figure: Figure
    axes: Axes
    footer: Axes  # The strip below; its coordinates are inches from its lower left corner


def map_figure(
    bounds: Bounds,
    *,
    title: str,
    subtitle: str = "",
    credit: str | None = None,
    legend: Sequence[LegendEntry] = (),
    longest_in: float | None = None,
) -> MapFigure:
    """A figure for a map of `bounds`: draw the world into `axes`; whatever else fits below goes into `footer`.

    Args:
        bounds: what the map shows, in metres; the frame takes its proportions.
        credit: who is named in the lower right corner (see `world.store.attribution`).
        longest_in: the longer side of the frame, in inches; 9 to 13 by its proportions when not given.
    """
    west, south, east, north = bounds
    longer, shorter = max(east - west, north - south), min(east - west, north - south)
    if longest_in is None:
        longest_in = min(max(9.0, 6.0 * longer / shorter), 13.0)
    scale = longest_in / longer
    width, height = max((east - west) * scale, 4.0), max((north - south) * scale, 2.5)
    beside = width >= _NARROW_IN
    widest = max((text_width_pt(entry.label, _LEGEND_PT) / 72 + 0.42 for entry in legend), default=1.0)
    columns = max(1, int((width - _SCALE_BAR_IN if beside else width) // widest))
    drop = 0.17 if beside else 0.72
    rows = ceil(len(legend) / columns)
    margin, head, foot = 0.25, 0.55 if subtitle else 0.42, max(0.68, drop + 0.05 + _ROW_IN * rows)
    figure = new_figure(width + 2 * margin, height + head + foot)
    total_w, total_h = figure.get_size_inches()
    axes = axes_in(figure, margin, foot, width, height)
    frame_axes(axes, bounds)
    footer = panel(figure, margin, 0.0, width, foot)
    figure.text(margin / total_w, 1 - 0.1 / total_h, title, fontsize=12, fontweight="bold", va="top")
    figure.text(margin / total_w, 1 - 0.34 / total_h, subtitle, fontsize=7.5, color=INK_SOFT, va="top")
    north_arrow(footer, width - 0.09, foot - 0.28, 0.22)
    west, east = axes.get_xlim()
    scale_bar(footer, width - 0.42, foot - 0.3, width / (east - west))
    if credit:
        footer.text(width, foot - 0.5, credit, fontsize=5.8, color=INK_SOFT, ha="right", va="center")
    if legend:
        footer.legend(
            handles=[entry.handle for entry in legend], ncols=columns, fontsize=_LEGEND_PT, loc="upper left",
            bbox_to_anchor=(0, 1 - (drop - _ROW_IN / 2) / foot), borderpad=0, borderaxespad=0, labelspacing=0.68,
            columnspacing=1.5,
        )  # fmt: skip
    return MapFigure(figure, axes, footer)


_NARROW_IN, _SCALE_BAR_IN = 6.0, 2.4
_ROW_IN, _LEGEND_PT = 0.165, 6.4


@cache
def text_width_pt(text: str, size_pt: float, *, bold: bool = False) -> float:
    if not text:
        return 0.0
    if not readable(text):
        return len(text) * size_pt
    prop = font_properties(text, bold=bold, size=100)
    width, _, _ = text_to_path.get_text_width_height_descent(text, prop, ismath=False)
    return float(width) * size_pt / 100


def fitted(bounds: Bounds, ratio: float) -> Bounds:
    """Bounds grown around their middle until width / height is `ratio`."""
    west, south, east, north = bounds
    width, height = max(east - west, (north - south) * ratio), max(north - south, (east - west) / ratio)
    x, y = (west + east) / 2, (south + north) / 2
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


def frame_axes(axes: Axes, bounds: Bounds) -> None:
    """Make axes a map of `bounds`, in metres, extended to the frame's proportions: equal scales, a thin frame, no
    ticks."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width, height = axes.get_position().size * figure.get_size_inches()
    west, south, east, north = fitted(bounds, float(width / height))
    axes.set(xlim=(west, east), ylim=(south, north), xticks=[], yticks=[], facecolor=GROUND)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(visible=True, color=INK_FAINT, linewidth=0.6, zorder=90)
    axes.apply_aspect()


def scale_bar(axes: Axes, right: float, y: float, unit_per_m: float, *, longest: float = 1.6) -> None:
    """A scale bar in the coordinates of `axes` (inches in a sheet's footer), ending at `right`.

    Args:
        unit_per_m: how many of those coordinates a metre of the map takes.
        longest: the bar is the longest of 1, 2, 5 · 10ⁿ metres below this length.
    """
    length_m = nice_length_m(longest / unit_per_m)
    length = length_m * unit_per_m
    left, height = right - length, 0.045
    axes.broken_barh([(left + part * length / 4, length / 4) for part in (0, 2)], (y, height), facecolor=INK)
    axes.add_patch(Rectangle((left, y), length, height, facecolor="none", edgecolor=INK, linewidth=0.5))
    for share in (0.0, 0.5, 1.0):
        unit = " m" if share == 1.0 else ""
        axes.text(left + share * length, y + 0.09, f"{share * length_m:g}{unit}", fontsize=6, ha="center", va="bottom")


def north_arrow(axes: Axes, x: float, y: float, size: float = 0.26, *, turn_rad: float = 0.0) -> None:
    """A slim arrow to the north, turned anticlockwise, its middle at (x, y) in the coordinates of `axes`."""
    place = Affine2D().scale(size).rotate(turn_rad).translate(x, y)
    for side, colour in ((-0.24, INK), (0.24, PAPER)):
        half = place.transform([(0, 0.5), (side, -0.5), (0, -0.26)])
        axes.fill(*half.T, facecolor=colour, edgecolor=INK, linewidth=0.5)
    label_x, label_y = place.transform((0, 0.76))
    axes.text(label_x, label_y, "N", fontsize=6, fontweight="bold", ha="center", va="center")


def nice_length_m(longest_m: float) -> float:
    """The greatest of 1, 2, 5 · 10ⁿ that is not above `longest_m`."""
    power = 10.0 ** floor(log10(longest_m))
    return next(factor * power for factor in (5, 2, 1) if factor * power <= longest_m * (1 + 1e-9))


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, SVG or PDF by the path's suffix; the same figure gives the same bytes.

    A PNG has a palette of 256 colours, which keeps the appearance of a map at a third of the size.

    Raises:
        PaveTwinError: the suffix is none of these, or the file cannot be written. Nothing is left behind.
    """
    metadata: dict[str, dict[str, Any]] = {
        ".png": {"Software": None},
        ".svg": {"Date": None, "Creator": None},
        ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }
    kind = path.suffix.lower()
    if kind not in metadata:
        raise PaveTwinError(f"An image cannot be written as '{path.name}'; end its name in .png, .svg or .pdf.")
    with writing(path) as temporary, styled():
        matplotlib.rcParams["svg.hashsalt"] = "pavetwin"
        choose_fonts(figure)
        if kind != ".png":
            figure.savefig(temporary, format=kind[1:], dpi=DPI, metadata=metadata[kind])
            return
        with_palette(_pixels(figure)).save(temporary, format="PNG")


def _pixels(figure: Figure) -> UInt8Array:
    """(height, width, 4) of a figure as it is saved. `savefig` would encode and decode them, in several copies that
    dominate the memory of drawing a map."""
    canvas = FigureCanvasAgg(figure)
    figure.set(dpi=DPI, facecolor=PAPER)
    canvas.draw()  # type: ignore[no-untyped-call]
    buffer: memoryview = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return np.asarray(buffer)


def with_palette(rgba: UInt8Array) -> Image.Image:
    """An opaque image (height, width, 4) in 256 colours, chosen so that every colour of the image is close to one of
    them.

    Pillow chooses among the image's colours, each as often as the power 0.7 of its pixels: areas of one colour have the
    greatest weight, with far fewer samples than pixels. No dithering.
    """
    # As 0xRRGGBB, without arrays of each channel, for the same reason.
    codes = np.ascontiguousarray(rgba).view(">u4")[..., 0].astype("<u4")
    codes >>= 8
    colours, pixels = np.unique(codes, return_counts=True)
    times = np.ceil(pixels**0.7).astype(np.intp)
    rgb = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=-1).astype(np.uint8)
    samples = np.repeat(rgb, times, axis=0)
    chosen = Image.fromarray(samples[None]).quantize(256, Image.Quantize.MAXCOVERAGE, 1, dither=Image.Dither.NONE)
    index = np.zeros(1 << 24, dtype=np.uint8)
    index[colours] = np.asarray(chosen)[0, np.cumsum(times) - times]
    result = Image.fromarray(index[codes])
    result.putpalette(chosen.getpalette() or [])
    return result
