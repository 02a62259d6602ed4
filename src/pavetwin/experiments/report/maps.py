"""Coverage maps: segments coloured by their mean coverage, over the muted map of their world."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
import shapely
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize

from pavetwin.draw import shapes, style
from pavetwin.draw.extent import credit, world_bounds
from pavetwin.draw.lettering import OccupiedSpace
from pavetwin.draw.world_map import ABOVE_WORLD, EVERYTHING, MapLayer, draw_world
from pavetwin.reports.blocks import ReportFigure
from pavetwin.reports.canvas import raster
from pavetwin.reports.words import counted
from pavetwin.world.model import Segment, World

COVERAGE: Final[Colormap] = LinearSegmentedColormap.from_list(
    "coverage", ["#46093B", "#8E2A5B", "#D05A5A", "#F09A5B", "#FBE08A"]
)
"""From little (dark) to much (light): lightness rises evenly, so that it holds in grey print."""

_THINNEST_PT, _RIM_PT, _NUMBER_PT = 2.6, 1.0, 4.6
_LONGEST_IN = 6.9


def street_means(result: pl.DataFrame, world: str) -> pl.DataFrame:
    """A row a segment: `street`, `segment`, `length_m`, `missions` with a defined coverage, `replicates`,
    `defects` (each replicate's once), `coverage`, `time_s` (means); the least covered first.
    """
    return (
        result.filter(pl.col("world") == world, pl.col("coverage").is_not_null())
        .group_by("segment", maintain_order=True)
        .agg(
            pl.col("street", "length_m").first(),
            pl.len().alias("missions"),
            pl.col("replicate").n_unique().alias("replicates"),
            pl.struct("replicate", "defects").unique().struct.field("defects").sum().alias("defects"),
            pl.col("coverage", "time_s").mean(),
        )
        .sort("coverage", "segment")
    )


def street_map(world: World, means: pl.DataFrame) -> ReportFigure | None:
    """The map of a world with its segments coloured; None when none of them is in it."""
    found = {row["segment"]: row for row in means.iter_rows(named=True)}
    segments = [segment for segment in world.segments if segment.id in found]
    if not segments:
        return None
    values = [100 * float(found[segment.id]["coverage"]) for segment in segments]
    norm = colour_range(values)
    with style.styled():
        framed = style.map_figure(
            world_bounds(world),
            title=world.name,
            subtitle="Mean coverage and number of missions of each segment",
            credit=credit(world),
            longest_in=_LONGEST_IN,
        )
        draw_world(
            framed.axes, world, layers=EVERYTHING - {MapLayer.FURNITURE, MapLayer.BASE}, defects=False, muted=True
        )
        _segments(framed.axes, segments, COVERAGE(norm(values)))
        _numbers(framed.axes, segments, found)
        _colour_bar(framed.footer, norm)
        return raster(framed.figure, _caption(world, found, segments), _alt(world, segments, values))


def colour_range(values: Sequence[float]) -> Normalize:
    """The tens around some percentages: ten of them at least, and none above 100."""
    low = min(np.floor(min(values) / 10) * 10, 90.0)
    return Normalize(float(low), float(max(np.ceil(max(values) / 10) * 10, low + 10)))


def _segments(axes: Axes, segments: Sequence[Segment], colours: Any) -> None:
    """Bands along the centre lines, as wide as the street or at least as wide as can be seen, with a dark rim."""
    per_m = shapes.points_per_m(axes)
    for segment, colour in zip(segments, colours, strict=True):
        line = shapely.get_coordinates(segment.centre_line)
        width = max(segment.width_m * per_m, _THINNEST_PT)
        shapes.strokes(axes, [line], ABOVE_WORLD, style.INK, width + _RIM_PT)
        shapes.strokes(axes, [line], ABOVE_WORLD + 1, colour, width)


def _numbers(axes: Axes, segments: Sequence[Segment], found: Mapping[str, Any]) -> None:
    """How many missions, in the middle of each segment where it fits."""
    per_m, occupied = shapes.points_per_m(axes), OccupiedSpace()
    for segment in sorted(segments, key=lambda segment: (-segment.length_m, segment.id)):
        text = f"{found[segment.id]['missions']}"
        middle = segment.centre_line.interpolate(0.5, normalized=True)
        half = (style.text_width_pt(text, _NUMBER_PT, bold=True) / 2 + 1.2) / per_m
        plate = shapely.box(middle.x - half, middle.y - 3.2 / per_m, middle.x + half, middle.y + 3.2 / per_m)
        if not occupied.free(plate):
            continue
        occupied.take(plate)
        axes.text(
            middle.x, middle.y, text, fontsize=_NUMBER_PT, fontweight="bold", ha="center", va="center_baseline",
            color=style.INK, path_effects=style.halo(1.5), zorder=ABOVE_WORLD + 3,
        )  # fmt: skip


def _colour_bar(footer: Axes, norm: Normalize) -> None:
    """In the strip below the map, whose coordinates are inches."""
    place = footer.inset_axes((0.12, footer.get_ylim()[1] - 0.26, 2.0, 0.12), transform=footer.transData)
    ticks = norm.inverse(np.linspace(0, 1, 3)).tolist()
    bar = Colorbar(place, ScalarMappable(norm, COVERAGE), orientation="horizontal", ticks=ticks, format="{x:g} %")
    bar.outline.set_visible(False)
    place.tick_params(labelsize=6, length=0, pad=2, labelcolor=style.INK)
    place.set_title("mean coverage", fontsize=6, fontweight="normal", pad=2)


def _caption(world: World, found: Mapping[str, Any], segments: Sequence[Segment]) -> str:
    missions = sum(row["missions"] for row in found.values())
    return (
        f"Mean coverage by segment in {world.name}: {counted(len(segments), 'segment')} of {len(world.segments)}, "
        f"{counted(missions, 'mission')} with a defined coverage, all cells together. The number on a segment is "
        "that of its missions. A segment is flown in all cells of its replicates and in no other, so segments differ "
        "in their traffic and defects as well as in themselves."
    )


def _alt(world: World, segments: Sequence[Segment], values: Sequence[float]) -> str:
    return (
        f"Map of {world.name} with {counted(len(segments), 'segment')} coloured by mean coverage, from "
        f"{min(values):.0f} to {max(values):.0f} %."
    )
