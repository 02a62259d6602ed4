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

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, Int32Array, UInt8Array
from pavetwin.scene.model import MAP_MARGIN_M, MAP_PX, TILE_M

SIDE_M: Final = TILE_M + 2 * MAP_MARGIN_M

_LEG_M: Final = 5.0
"""Longer segments are split: the window around an oblique segment grows with its length squared."""


SAMPLES: Final = 3
"""Points along each side of a cell of `filled`. Pillow fills pixels that an edge only touches: edges lie a ninth of a
cell too far out."""


@dataclass(frozen=True)
class Window:
    """A window of a grid, and the centres of its cells, in metres from the grid's south-west corner."""

    at: tuple[slice, slice]
    x: Float32Array
    """(1, columns)"""
    y: Float32Array
    """(rows, 1)"""


class RasterGrid:
    """A square grid over a tile and its margin; row 0 is south."""

    def __init__(self, key: tuple[int, int], px: int = MAP_PX) -> None:
        self.px = px
        self.cell_m = SIDE_M / px
        self.origin = np.array([key[0] * TILE_M - MAP_MARGIN_M, key[1] * TILE_M - MAP_MARGIN_M])
        self.middles = ((np.arange(px) + 0.5) * self.cell_m).astype(np.float32)

    def full(self, value: float) -> Float32Array:
        return np.full((self.px, self.px), value, dtype=np.float32)

    def window(self, low: npt.ArrayLike, high: npt.ArrayLike) -> Window | None:
        """The cells between two corners, in metres from the grid's corner; None when there are none."""
        first = np.clip(np.floor(np.asarray(low) / self.cell_m - 0.5).astype(int), 0, self.px)
        last = np.clip(np.ceil(np.asarray(high) / self.cell_m + 0.5).astype(int), 0, self.px)
        if np.any(last <= first):
            return None
        columns, rows = slice(first[0], last[0]), slice(first[1], last[1])
        return Window((rows, columns), self.middles[None, columns], self.middles[rows, None])

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
    index = np.full((raster.px, raster.px), -1, dtype=np.int32)
    along, across, distance = raster.full(0.0), raster.full(0.0), raster.full(np.inf)
    for number, line in enumerate(lines):
        begin = 0.0 if begins_m is None else begins_m[number]
        for leg in _legs(raster.local(line), begin):
            window = raster.window(leg.low - reach_m[number], leg.high + reach_m[number])
            if window is None:
                continue
            ahead, left, away = leg.measure(window)
            best = distance[window.at]
            nearer = (away < best) & (away < reach_m[number])
            if flat:
                nearer &= (ahead >= 0 if leg.first else True) & (ahead <= leg.length if leg.last else True)
            if not nearer.any():
                continue
            foot = np.float32(leg.begin) + np.clip(ahead, 0.0, np.float32(leg.length))
            for field, value in ((index, number), (along, foot), (across, left), (distance, away)):
                np.copyto(field[window.at], value, where=nearer)
    return Tracks(index, along, across, distance)


@dataclass(frozen=True)
class _Leg:
    start: Float64Array
    direction: Float64Array
    length: float
    begin: float
    first: bool
    last: bool

    @property
    def low(self) -> Float64Array:
        return np.minimum(self.start, self.start + self.direction * self.length)

    @property
    def high(self) -> Float64Array:
        return np.maximum(self.start, self.start + self.direction * self.length)

    def measure(self, window: Window) -> tuple[Float32Array, Float32Array, Float32Array]:
        """Way ahead of the start, offset to the left, distance, for each cell."""
        dx, dy = (np.float32(value) for value in self.direction)
        x, y = window.x - np.float32(self.start[0]), window.y - np.float32(self.start[1])
        ahead, left = dx * x + dy * y, dx * y - dy * x
        beyond = np.maximum(np.maximum(-ahead, ahead - np.float32(self.length)), np.float32(0))
        return ahead, left, np.sqrt(left * left + beyond * beyond)


def _legs(line: Float64Array, begin: float) -> Iterator[_Leg]:
    """A line's straight parts, none longer than _LEG_M."""
    steps = np.diff(line, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    kept = np.flatnonzero(lengths > 1e-6)
    for leg in kept:
        direction = steps[leg] / lengths[leg]
        parts = max(1, math.ceil(lengths[leg] / _LEG_M))
        length = float(lengths[leg]) / parts
        for part in range(parts):
            yield _Leg(
                start=line[leg] + direction * (part * length),
                direction=direction,
                length=length,
                begin=begin,
                first=bool(leg == kept[0]) and part == 0,
                last=bool(leg == kept[-1]) and part == parts - 1,
            )
            begin += length


def bars(raster: RasterGrid, bars_xyahw: Float64Array, reach_m: float) -> Iterator[tuple[int, Window, Float32Array]]:
    """Signed distances to oriented rectangles, positive inside, in the window where they exceed −reach.

    Args:
        bars_xyahw: (n, 5): middle x and y in the world frame, direction [rad], half length, half width [m].
        reach_m: how far outside.
    """
    middle = bars_xyahw[:, :2]
    cos, sin = np.cos(bars_xyahw[:, 2]), np.sin(bars_xyahw[:, 2])
    half, wide = bars_xyahw[:, 3], bars_xyahw[:, 4]
    extent = (
        np.column_stack([np.abs(cos) * half + np.abs(sin) * wide, np.abs(sin) * half + np.abs(cos) * wide]) + reach_m
    )
    for number in np.flatnonzero(raster.meets(middle - extent, middle + extent)):
        at = raster.local(middle[number])
        window = raster.window(at - extent[number], at + extent[number])
        if window is None:
            continue
        x, y = window.x - np.float32(at[0]), window.y - np.float32(at[1])
        c, s = np.float32(cos[number]), np.float32(sin[number])
        u = np.abs(c * x + s * y) - np.float32(half[number])
        v = np.abs(c * y - s * x) - np.float32(wide[number])
        outside = np.sqrt(np.maximum(u, 0) ** 2 + np.maximum(v, 0) ** 2)
        yield int(number), window, -(outside + np.minimum(np.maximum(u, v), 0))


def outlines(
    raster: RasterGrid, rings: Sequence[Float64Array], reach_m: float
) -> Iterator[tuple[int, Window, Float32Array]]:
    """Signed distances to polygons (n, 2) in the world frame, positive inside, as `bars` gives them."""
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
