"""Shapes of the world as Matplotlib collections, one per layer, which draws a town quickly.

Lengths are metres of the world frame unless a name ends in `_pt` (points).
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, PathCollection
from matplotlib.colors import to_rgb
from matplotlib.path import Path as Outline
from matplotlib.typing import ColorType
from shapely import Geometry, LineString, Polygon

from pavetwin.arrays import Float64Array, IndexArray

Colours = ColorType | Sequence[ColorType] | Float64Array
"""One for all, or one each; as an array, (n, 4)."""


def mix(colour: ColorType, other: ColorType, share: float) -> tuple[float, float, float]:
    """`colour` with a share of `other` in it, 0 … 1."""
    a, b = np.array(to_rgb(colour)), np.array(to_rgb(other))
    red, green, blue = a + (b - a) * share
    return float(red), float(green), float(blue)


def points_per_m(axes: Axes) -> float:
    """Points of paper per metre of the map."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    west, east = axes.get_xlim()
    return float(axes.get_position().width * figure.get_size_inches()[0] * 72 / (east - west))


def seen(axes: Axes, shapes: Sequence[Geometry]) -> IndexArray:
    """The indices of the shapes within 5 m of the map."""
    if not len(shapes):
        return np.empty(0, dtype=np.intp)
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    boxes = shapely.bounds(np.asarray(shapes, dtype=object))
    beside = (boxes[:, 0] > east + 5.0) | (boxes[:, 2] < west - 5.0)
    above = (boxes[:, 1] > north + 5.0) | (boxes[:, 3] < south - 5.0)
    return np.flatnonzero(~(beside | above) & np.isfinite(boxes[:, 0]))


def outline(shape: Geometry) -> Outline:
    """A polygon, or several, with their holes, as one path."""
    rings = [
        Outline(np.asarray(ring.coords)[:, :2], closed=True)
        for part in shapely.get_parts(shape)
        if isinstance(part, Polygon) and not part.is_empty
        for ring in (part.exterior, *part.interiors)
    ]
    return Outline.make_compound_path(*rings)


def fill(
    axes: Axes,
    shapes: Sequence[Geometry | Outline],
    zorder: float,
    face: Colours,
    edge: Colours = "none",
    width_pt: float = 0.0,
    alpha: float | None = None,
) -> None:
    """Polygons or paths, filled with one colour or one each."""
    outlines = [shape if isinstance(shape, Outline) else outline(shape) for shape in shapes]
    paths = PathCollection(outlines, facecolors=face, edgecolors=edge, linewidths=width_pt, joinstyle="round")
    paths.set(alpha=alpha, zorder=zorder)
    axes.add_collection(paths, autolim=False)


def discs(
    axes: Axes,
    centres: Float64Array,
    radii_m: Float64Array,
    zorder: float,
    face: ColorType,
    edge: ColorType = "none",
    width_pt: float = 0.0,
    alpha: float = 1.0,
) -> None:
    """Circles of a size in metres, at centres (n, 2)."""
    circles = EllipseCollection(
        2 * radii_m, 2 * radii_m, np.zeros_like(radii_m), units="xy", offsets=centres, offset_transform=axes.transData
    )
    circles.set(facecolors=face, edgecolors=edge, linewidths=width_pt, alpha=alpha, zorder=zorder)
    axes.add_collection(circles, autolim=False)


def strokes(
    axes: Axes,
    lines: Sequence[npt.ArrayLike],
    zorder: float,
    colour: ColorType,
    width_pt: float,
    dash_pt: tuple[float, float] | None = None,
) -> None:
    """Lines, whole or dashed (drawn and left out, in points)."""
    style = "solid" if dash_pt is None else (0, (dash_pt[0] / width_pt, dash_pt[1] / width_pt))
    drawn = LineCollection([np.asarray(line) for line in lines], colors=colour, linewidths=width_pt, linestyles=style)
    drawn.set(zorder=zorder, capstyle="butt")
    axes.add_collection(drawn, autolim=False)


def shadow(bases: Sequence[Polygon], heights_m: Float64Array, east: float, south: float, longest_m: float) -> Outline:
    """The shadows of upright objects on the ground, courtyards included, without the area of their own bases.

    A base swept along a line is the base and each of its sides swept. The sides make parallelograms, all turned the
    same way round, so that where they overlap the path is filled once.

    Args:
        bases, heights_m: (n,) polygons and how high they are.
        east, south: metres of shadow a metre of height.
        longest_m: of a shadow; a map's shadow is an ornament and must not hide a street.
    """
    rings, base_of_ring = shapely.get_rings(np.asarray(bases, dtype=object), return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    same = ring[:-1] == ring[1:]
    start, end = points[:-1][same], points[1:][same]
    if not len(start):
        return Outline(np.empty((0, 2)))
    reach = np.minimum(heights_m, longest_m / np.hypot(east, south))[base_of_ring[ring[:-1][same]]]
    away = np.stack([east * reach, -south * reach], axis=-1)
    sides = np.stack([start, end, end + away, start + away, start], axis=1)
    along = end - start
    clockwise = along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0] < 0
    sides[clockwise] = sides[clockwise, ::-1]
    codes = np.tile([Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY], len(sides))
    return Outline(sides.reshape(-1, 2), codes)


_INSET_M = 0.3  # From the end of a crossing's bar to the crossing's side


def stripes(rectangle: Polygon, width_m: float, gap_m: float) -> list[Float64Array]:
    """Bars across the longer axis of a rectangle (a zebra crossing's): lines of two points."""
    ring = shapely.get_coordinates(rectangle.minimum_rotated_rectangle)
    if len(ring) < 5:
        return []
    sides = np.diff(ring[:3], axis=0)
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    long = int(np.argmax(lengths))
    if lengths.min() <= 2 * _INSET_M:
        return []
    along, across = sides[long] / lengths[long], sides[1 - long]
    start = ring[0] if long == 0 else ring[1] - across
    count = int((lengths[long] - 2 * _INSET_M + gap_m) // (width_m + gap_m))
    spare = lengths[long] - count * (width_m + gap_m) + gap_m
    inner = _INSET_M / lengths[1 - long]
    offsets = spare / 2 + width_m / 2 + np.arange(count) * (width_m + gap_m)
    return [np.stack([start + along * s + across * inner, start + along * s + across * (1 - inner)]) for s in offsets]


def ticks(line: LineString, half_m: float) -> list[Float64Array]:
    """A short line across each end of `line`, reaching `half_m` to both sides."""
    points = shapely.get_coordinates(line)
    marks = []
    for end, inner in ((points[0], points[1]), (points[-1], points[-2])):
        direction = (end - inner) / max(float(np.hypot(*(end - inner))), 1e-9)
        side = np.array([-direction[1], direction[0]]) * half_m
        marks.append(np.stack([end - side, end + side]))
    return marks
