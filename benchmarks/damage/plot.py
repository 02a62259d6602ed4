"""The distributions in one picture, beside those of the sources."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import lognorm

from benchmarks.damage import statistics as stats
from benchmarks.damage.placed import Placed
from benchmarks.damage.sources import CLASSES, COUNTS, NAMES, POTHOLES_PER_KM, Photographs
from benchmarks.damage.table import LEAST_BOXES
from benchmarks.damage.widths import crack_widths
from pavetwin.arrays import Float64Array
from pavetwin.defects.severity import CRACK_MEDIUM_M
from pavetwin.draw import style

Panel = Callable[[Axes, Placed, Sequence[Photographs]], None]

ACROSS, DOWN = 4, 2
WIDTH_IN, HEIGHT_IN = 2.35, 1.75
GAP_IN: Final = (0.62, 0.85)
OURS, THEIRS, LIGHT, PLAIN = "#1F6FB2", "#C2571A", "#E8B48C", "#B9B3A9"
DASHES: Final = ((0, (3, 2)), (0, (1, 1.2)))
SEVERITIES: Final = ("#D9D4CB", "#E0A458", "#A63446")


def save_plot(found: Placed, seen: Sequence[Photographs], path: Path) -> None:
    """Eight panels; what is placed is blue, what photographs show is orange."""
    panels: tuple[tuple[str, Panel], ...] = (
        ("Classes", _mix),
        ("Boxes of defects", _sizes),
        ("Severity (ASTM D6433)", _severity),
        ("Width of cracks", _widths),
        ("Density by street", _density),
        ("Distance of two defects", _pairs),
        ("Cracks along the street", _lanes),
        ("Boxes in one view", _views),
    )
    with style.styled():
        width = 0.55 + ACROSS * (WIDTH_IN + GAP_IN[0]) - GAP_IN[0] + 0.15
        figure = style.new_figure(width, 0.5 + DOWN * (HEIGHT_IN + GAP_IN[1]) - 0.55)
        for number, (title, draw) in enumerate(panels):
            axes = _axes(figure, number)
            axes.set_title(title, fontsize=8)
            draw(axes, found, seen)
        style.save_figure(figure, path)


def _axes(figure: Figure, number: int) -> Axes:
    row, column = divmod(number, ACROSS)
    left = 0.55 + column * (WIDTH_IN + GAP_IN[0])
    bottom = 0.5 + (DOWN - 1 - row) * (HEIGHT_IN + GAP_IN[1])
    return style.axes_in(figure, left, bottom, WIDTH_IN, HEIGHT_IN)


def _mix(axes: Axes, found: Placed, _seen: Sequence[Photographs]) -> None:
    shown = {"placed": stats.mix(found)} | {name: np.array(counts) / sum(counts) for name, counts in COUNTS.items()}
    for at, (name, shares) in enumerate(shown.items()):
        places = np.arange(len(CLASSES)) + 0.27 * (at - 1)
        axes.bar(places, 100 * shares, 0.25, color=(OURS, THEIRS, LIGHT)[at], label=name)
        for place, share in zip(places, shares, strict=True):
            axes.annotate(
                f"{100 * share:.0f}",
                (place, 100 * share),
                (0, 1.5),
                textcoords="offset points",
                ha="center",
                fontsize=6,
            )
    axes.set_xticks(range(len(CLASSES)), [NAMES[kind] for kind in CLASSES])
    axes.set_ylabel("%")
    axes.grid(visible=False, axis="x")
    axes.legend()


def _sizes(axes: Axes, found: Placed, seen: Sequence[Photographs]) -> None:
    grid = np.geomspace(0.1, 12, 200)
    for kind in CLASSES:
        colour = style.DEFECT_COLOURS[kind]
        sizes = np.sort(stats.box_sizes(found, kind))
        axes.plot(sizes, 100 * np.arange(1, len(sizes) + 1) / len(sizes), color=colour, label=NAMES[kind])
        for source, dash in zip(seen, DASHES, strict=False):
            boxes = stats.photographed(found, source, kind)
            if len(boxes[0]) >= LEAST_BOXES:
                fit = stats.fitted(*boxes)
                theirs = lognorm.cdf(grid, fit.sigma, scale=fit.median)
                axes.plot(grid, 100 * theirs, color=colour, linewidth=1.0, linestyle=dash)
    axes.set(xscale="log", xlim=(0.1, 12), ylim=(0, 100), ylabel="% are smaller")
    axes.set_xticks([0.1, 0.3, 1, 3, 10], ["0.1", "0.3", "1", "3", "10"])
    known = zip(
        (f"{source.name} at {stats.resolutions(found, source)}" for source in seen),
        ("– –", "· ·"),
        strict=False,
    )
    axes.set_xlabel("; ".join(["m", *(f"{dash} {name}" for name, dash in known)]), fontsize=6.5)
    axes.legend(loc="upper left", handlelength=1.2)


def _severity(axes: Axes, found: Placed, _seen: Sequence[Photographs]) -> None:
    shares = np.array([stats.severities(found, kind) for kind in CLASSES])
    left = np.zeros(len(CLASSES))
    for at, name in enumerate(("low", "medium", "high")):
        axes.barh(range(len(CLASSES)), 100 * shares[:, at], 0.6, left=100 * left, color=SEVERITIES[at], label=name)
        for row, share in enumerate(shares[:, at]):
            if share > 0.06:
                axes.annotate(
                    f"{100 * share:.0f}", (100 * (left[row] + share / 2), row), ha="center", va="center", fontsize=6.5
                )
        left = left + shares[:, at]
    axes.set_yticks(range(len(CLASSES)), [NAMES[kind] for kind in CLASSES], rotation=90, va="center")
    axes.set(xlim=(0, 100), ylim=(2.5, -0.5), xlabel="%")
    axes.grid(visible=False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3)


def _widths(axes: Axes, found: Placed, seen: Sequence[Photographs]) -> None:
    widths = 1000 * found.of("single_crack")["width_m"].to_numpy()
    axes.hist(widths, np.geomspace(1, 80, 30), color=OURS, weights=np.full(len(widths), 100 / len(widths)))
    axes.axvline(1000 * CRACK_MEDIUM_M, color=style.INK_SOFT, linewidth=0.8, linestyle=(0, (3, 2)))
    axes.annotate("medium\nseverity", (11, 0.62), xycoords=("data", "axes fraction"), fontsize=6.5, va="top")
    for source, colour in zip(seen, (THEIRS, LIGHT), strict=False):
        middle = 1000 * float(np.median(crack_widths(source, stats.pixel_m(found, source))))
        axes.axvline(middle, color=colour, linewidth=1.2, label=f"median, {source.name}")
    if seen:
        axes.legend(loc="upper right", handlelength=1.0, borderaxespad=0)
    axes.set_ylim(0, 1.6 * axes.get_ylim()[1])
    axes.set(xscale="log", xlim=(1, 80), ylabel="% of cracks", xlabel="mm where they are widest")
    axes.set_xticks([1, 3, 10, 30], ["1", "3", "10", "30"])


def _density(axes: Axes, found: Placed, _seen: Sequence[Photographs]) -> None:
    streets = stats.per_km(found)["per_km"].to_numpy()
    least = 10.0
    edges = np.geomspace(least, 3000, 18)
    axes.hist(np.maximum(streets, least), edges, color=OURS, weights=np.full(len(streets), 100 / len(streets)))
    fit = stats.fitted(streets[streets > 0])
    shares = np.diff(lognorm.cdf(edges, fit.sigma, scale=fit.median)) * float((streets > 0).mean())
    label = f"lognormal, σ {fit.sigma:.2f}"
    axes.plot(np.sqrt(edges[1:] * edges[:-1]), 100 * shares, color=style.INK, linewidth=0.9, label=label)
    axes.legend(loc="upper right", handlelength=1.2)
    axes.set_ylim(0, 1.3 * axes.get_ylim()[1])
    holes = stats.per_km(found, "pothole", by="town")
    mean = 1000 * holes["number"].sum() / holes["length_m"].sum()
    ends = sorted(POTHOLES_PER_KM.values())
    axes.set(xscale="log", xlim=(least, 3000), ylabel="% of streets", xlabel="defects a kilometre")
    axes.set_xticks([10, 30, 100, 300, 1000, 3000], ["≤ 10", "30", "100", "300", "1000", ""])
    axes.annotate(
        f"potholes a km: {mean:.1f}\nsources: {ends[0]:.1f} to {ends[-1]:.0f}",
        (0.03, 0.97), xycoords="axes fraction", va="top", fontsize=6.5,
    )  # fmt: skip


def _pairs(axes: Axes, found: Placed, _seen: Sequence[Photographs]) -> None:
    near = stats.pairs(found)
    axes.plot(near.distance_m, near.over_all, color=OURS, label="as at random on all streets")
    axes.plot(near.distance_m, near.on_streets, color=OURS, linestyle=(0, (3, 2)), label="as at random on the segment")
    axes.axhline(1, color=style.INK_SOFT, linewidth=0.6)
    axes.set(xlim=(0, 10), ylim=(0, 1.45 * float(near.over_all.max())), ylabel="times as many pairs", xlabel="m apart")
    axes.legend(loc="upper right", handlelength=1.6)


def _lanes(axes: Axes, found: Placed, _seen: Sequence[Photographs]) -> None:
    lanes = stats.from_lane_centres(found)["from_centre_m"].to_numpy()
    edges = np.arange(0, 2.6, 0.1)
    axes.hist(lanes, edges, color=OURS, weights=np.full(len(lanes), 100 / len(lanes)))
    axes.axvspan(*stats.WHEEL_PATH_M, color=PLAIN, alpha=0.35, zorder=0, linewidth=0)
    axes.annotate("wheel path", (1.15, 0.80), xycoords=("data", "axes fraction"), ha="left", va="top", fontsize=6.5)
    axes.annotate(
        "joint or\nedge", (1.85, 0.97), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=6.5
    )
    axes.set(xlim=(0, 2.5), ylabel="% of them", xlabel="m from the middle of the lane")


def _views(axes: Axes, found: Placed, seen: Sequence[Photographs]) -> None:
    side_m = seen[0].side_px * stats.pixel_m(found, seen[0]) if seen else 3.0
    shown: list[tuple[str, str, Float64Array]] = [("placed", OURS, stats.boxes_in_view(found, side_m))]
    shown += [(source.name, THEIRS, stats.boxes_in_photographs(source)) for source in seen[:1]]
    for at, (name, colour, shares) in enumerate(shown):
        axes.bar(np.arange(1, 6) + 0.4 * (at - 0.5), 100 * shares, 0.38, color=colour, label=name)
    axes.set_xticks(range(1, 6), ["1", "2", "3", "4", "≥ 5"])
    axes.set(ylabel="% of views with any", xlabel=f"boxes in {side_m:.1f} × {side_m:.1f} m")
    axes.grid(visible=False, axis="x")
    axes.legend()
