"""Distances to lines and outlines on a tile's raster grid, each computed only where needed."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from shapely.geometry.base import BaseGeometry

from pavetwin._core import raster_covered, raster_painted, raster_tracks
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray, Int32Array, UInt8Array
from pavetwin.scene.values import MAP_MARGIN_M, MAP_PX, TILE_M

SIDE_M: Final = TILE_M + 2 * MAP_MARGIN_M

COVER_REACH_M: Final = 0.05  # Beyond the edge of a cover, so that cells of which it covers a part are looked at
SAMPLES: Final = 3
"""Points along each side of a cell of `filled`. Pillow fills pixels that an edge only touches: edges lie a ninth of a
cell too far out."""


@dataclass(frozen=True)
class Window:
    """A window of a grid, and the centres of its cells, in metres from the grid's south-west corner."""

    at: tuple[slice, slice]
    x: Float32Array  # (1, columns)
    y: Float32Array  # (rows, 1)


class RasterGrid:
    """A square grid over a tile and its margin; row 0 is south."""

    def __init__(self, key: tuple[int, int], px: int = MAP_PX) -> None:
        self.px = px
        self.cell_m = SIDE_M / px
        self.origin = np.array([key[0] * TILE_M - MAP_MARGIN_M, key[1] * TILE_M - MAP_MARGIN_M])
        self.middles = ((np.arange(px) + 0.5) * self.cell_m).astype(np.float32)

    @property
    def lattice(self) -> tuple[int, float]:
        """Cells along a side, and the side of a cell [m], as the kernel takes them."""
        return self.px, self.cell_m

    def full(self, value: float) -> Float32Array:
        return np.full((self.px, self.px), value, dtype=np.float32)

    def window(self, low: Float64Array, high: Float64Array) -> Window | None:
        """The cells between two corners (2,), in metres from the grid's corner; None when there are none."""
        (west, south), (east, north) = low, high
        columns, rows = self._span(west, east), self._span(south, north)
        if columns.stop <= columns.start or rows.stop <= rows.start:
            return None
        return Window((rows, columns), self.middles[None, columns], self.middles[rows, None])

    def _span(self, low: float, high: float) -> slice:
        first, end = math.floor(low / self.cell_m - 0.5), math.ceil(high / self.cell_m + 0.5)
        return slice(min(max(first, 0), self.px), min(max(end, 0), self.px))

    def local(self, xy: npt.ArrayLike) -> Float64Array:
        """World points (..., 2) in metres from the grid's corner."""
        return np.asarray(np.asarray(xy, dtype=np.float64) - self.origin)

    def meets(self, low: Float64Array, high: Float64Array) -> BoolArray:
        """Which boxes (n, 2) to (n, 2), world frame, meet the grid."""
        return np.asarray(np.all((low <= self.origin + SIDE_M) & (high >= self.origin), axis=-1))

    def world_axes(self) -> tuple[Float64Array, Float64Array]:
        """World x of the columns and y of the rows."""
        return self.origin[0] + self.middles.astype(np.float64), self.origin[1] + self.middles.astype(np.float64)


@dataclass(frozen=True)
class Tracks:
    """For every cell of a grid the nearest of some lines."""

    index: Int32Array
    """Which line; −1 where none is within its reach."""
    along: Float32Array
    """Way along it to the foot [m]."""
    across: Float32Array
    """Offset to its left [m]."""
    distance: Float32Array
    """From it [m]; inf where there is none."""


def tracks(
    raster: RasterGrid,
    lines: Sequence[Float64Array],
    reach_m: Sequence[float],
    begins_m: Sequence[float] | None = None,
    *,
    flat: bool = False,
) -> Tracks:
    """The nearest line of every cell.

    Args:
        lines: (n, 2) each, world frame.
        reach_m: how far each is looked for.
        begins_m: the way at which each begins, 0 without.
        flat: whether nothing beyond a line's ends belongs to it.
    """
    points = raster.local(np.concatenate([np.empty((0, 2)), *lines]))
    offsets = np.cumsum([0, *map(len, lines)], dtype=np.uint32)
    begins = np.zeros(len(lines)) if begins_m is None else np.array(begins_m, dtype=np.float64)
    return Tracks(*raster_tracks(raster.lattice, points, offsets, np.array(reach_m, dtype=np.float64), begins, flat))


def painted(
    raster: RasterGrid, bars_xyahw: Float64Array, paints: Float64Array, most_m: Float64Array, reach_m: float
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """The bar of every cell that it lies farthest inside of, the first of several: the signed distance from its edge,
    positive inside, −reach where there is none, and its two paints, 0 where there is none.

    Args:
        bars_xyahw: (n, 5): middle x and y in the world frame, direction [rad], half length, half width [m].
        paints: (n, 2)
        most_m: (n,) greatest distance inside that counts.
        reach_m: how far outside.
    """
    near, rows = _near(raster, bars_xyahw, reach_m)
    shown = paints[near].astype(np.float32), most_m[near].astype(np.float32)
    return raster_painted(raster.lattice, rows, *shown, -reach_m)


def covered(raster: RasterGrid, bars_xyahw: Float64Array, factors: Float64Array) -> Float32Array:
    """The factor (n,) of bars (n, 5) where they are, 1 elsewhere; later ones cover earlier ones."""
    near, rows = _near(raster, bars_xyahw, COVER_REACH_M)
    return raster_covered(raster.lattice, rows, factors[near].astype(np.float32))


def _near(raster: RasterGrid, bars_xyahw: Float64Array, reach_m: float) -> tuple[IndexArray, Float64Array]:
    """Which bars may reach into the grid, and those as the kernel takes them."""
    middle = bars_xyahw[:, :2]
    cos, sin = np.cos(bars_xyahw[:, 2]), np.sin(bars_xyahw[:, 2])
    half, wide = bars_xyahw[:, 3], bars_xyahw[:, 4]
    extent = (
        np.column_stack([np.abs(cos) * half + np.abs(sin) * wide, np.abs(sin) * half + np.abs(cos) * wide]) + reach_m
    )
    near = np.flatnonzero(raster.meets(middle - extent, middle + extent))
    rows = np.column_stack([raster.local(middle), cos, sin, half, wide, extent])
    return near, rows[near]


def outlines(
    raster: RasterGrid, rings: Sequence[Float64Array], reach_m: float
) -> Iterator[tuple[int, Window, Float32Array]]:
    """Signed distances to polygons (n, 2) in the world frame, positive inside: the number of each that may reach into
    the grid, and its distances in a window around it, where they exceed −reach."""
    for number, ring in enumerate(rings):
        points = raster.local(ring)
        window = raster.window(points.min(axis=0) - reach_m, points.max(axis=0) + reach_m)
        if window is None:
            continue
        shape = (len(window.y), window.x.shape[1])
        nearest = np.full(shape, np.inf, dtype=np.float32)
        inside = np.zeros(shape, dtype=bool)
        for (ax, ay), (bx, by) in zip(points, np.roll(points, -1, axis=0), strict=True):
            ex, ey = bx - ax, by - ay
            x, y = window.x - np.float32(ax), window.y - np.float32(ay)
            share = np.clip((x * np.float32(ex) + y * np.float32(ey)) / np.float32(max(ex * ex + ey * ey, 1e-12)), 0, 1)
            nearest = np.minimum(nearest, (x - share * np.float32(ex)) ** 2 + (y - share * np.float32(ey)) ** 2)
            if ay != by:
                crosses = (window.y >= min(by, ay) - ay + ay) & (window.y < max(by, ay))
                inside ^= crosses & (x < (y * np.float32(ex / ey)))
        away = np.sqrt(nearest)
        yield number, window, np.where(inside, away, -away)


def filled(raster: RasterGrid, rings: Iterable[tuple[BaseGeometry, int]], level: int) -> Float32Array:
    """Rings filled with levels 0 … 255 over another level, later ones over earlier ones; the mean over each cell."""
    px, cell_m = raster.px * SAMPLES, raster.cell_m / SAMPLES
    image = Image.new("L", (px, px), level)
    pen = ImageDraw.Draw(image)
    for ring, inside in rings:
        # In Pillow's coordinates 0 is the centre of the first pixel.
        corners = raster.local(shapely.get_coordinates(ring)) / cell_m - 0.5
        pen.polygon([tuple(corner) for corner in corners.tolist()], fill=inside)
    return np.asarray(image.reduce(SAMPLES), dtype=np.float32)


def widened(field: Float32Array, px: int) -> Float32Array:
    """A coarser grid's field resampled on a finer one, bilinearly."""
    return np.asarray(cv2.resize(field, (px, px), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def bytes_of(*layers: Float32Array) -> UInt8Array:
    """Layers of values 0 … 255 as the channels of one map, rounded."""
    return np.asarray(cv2.merge([(layer + np.float32(0.5)).astype(np.uint8) for layer in layers]), dtype=np.uint8)
