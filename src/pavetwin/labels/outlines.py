"""Masks as one polygon each, for label formats without masks, and polygons as masks.

`outline` passes through the middles of the pixels on the border and is simplified: readers that draw it, border
included, find the mask. `boundary` passes along the edges of pixels, as boxes do, and is exact: flipped, rotated and
scaled, it still encloses the area of the mask. `filled` is its inverse.
"""

from collections import defaultdict
from itertools import pairwise
from typing import Final, cast

import numpy as np
import shapely
from contourpy import FillType, contour_generator

from pavetwin.arrays import BoolArray, Float64Array, IndexArray

TOLERANCE_PX: Final = 0.5
"""Outlines are simplified by at most this (Douglas and Peucker 1973)."""


def outline(mask: BoolArray) -> Float64Array:
    """The polygon (n ≥ 3, 2) of a mask (height, width) that is not empty: column, row of the pixels on its border.

    All parts of the mask and their holes are in it, joined by bridges that are passed both ways: the shortest that
    join all of them (Prim 1957). Filled by the even-odd rule, border included, it is the mask again, except for bridges
    between parts and the simplification.
    """
    rings = [_simplified(ring) for ring in _rings(mask)]
    path = _walk(rings, _bridges(rings))
    if len(path) > 2 and np.ptp(path, axis=0).all():
        return path
    # A line of pixels: its box, so that it has an area.
    left, top = path.min(axis=0)
    right, bottom = path.max(axis=0) + 0.9
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def boundary(mask: BoolArray) -> Float64Array:
    """The polygon (n ≥ 4, 2) of a mask (height, width) that is not empty: column, row along the edges of its pixels.

    The first pixel reaches from 0 to 1. Parts and holes are joined as in `outline`; `filled` gives the mask again.
    """
    padded = np.zeros((mask.shape[0], mask.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = mask
    steps = np.diff(padded, axis=1)
    rows, starts = np.nonzero(steps == 1)
    ends = np.nonzero(steps == -1)[1]
    covered = shapely.simplify(shapely.union_all(shapely.box(starts, rows, ends, rows + 1)), 0.0)
    lines = [ring for part in shapely.get_parts(covered) for ring in (part.exterior, *part.interiors)]
    rings = [shapely.get_coordinates(line)[:-1] for line in lines]
    return _walk(rings, _bridges(rings))


def hull(mask: BoolArray) -> Float64Array:
    """The corners (n ≥ 4, 2) of the convex hull of a mask (height, width) that is not empty: column, row along the
    edges of its pixels; the first pixel reaches from 0 to 1."""
    rows = np.flatnonzero(mask.any(axis=1))
    first, last = mask[rows].argmax(axis=1), mask.shape[1] - mask[rows, ::-1].argmax(axis=1)
    x, y = np.concatenate([first, last, first, last]), np.concatenate([rows, rows, rows + 1, rows + 1])
    return shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(np.column_stack([x, y]))))[:-1]


def filled(polygon: Float64Array, size_px: tuple[int, int]) -> BoolArray:
    """(height, width) The pixels whose middle lies in a polygon (n, 2) along pixel edges, by the even-odd rule.

    Pillow and OpenCV fill polygons of whole pixels and the border with them, which is up to a pixel more.

    Args:
        size_px: width, height of the image; the polygon may reach beyond.
    """
    width, height = size_px
    ends = np.stack([polygon, np.roll(polygon, -1, axis=0)], axis=1)
    # Both ways over a bridge are computed alike, so that they cancel exactly.
    downwards = np.lexsort((ends[..., 0], ends[..., 1]))
    (x, y), (to_x, to_y) = np.take_along_axis(ends, downwards[..., None], axis=1).transpose(1, 2, 0)
    first, last = (np.clip(np.ceil(each - 0.5), 0, height).astype(np.intp) for each in (y, to_y))
    side = np.repeat(np.arange(len(x)), last - first)
    rows = first[side] + np.arange(len(side)) - np.repeat(np.cumsum(last - first) - (last - first), last - first)
    crossed = x[side] + (rows + 0.5 - y[side]) * ((to_x - x)[side] / (to_y - y)[side])
    columns = np.clip(np.ceil(crossed - 0.5), 0, width).astype(np.intp)
    crossings = np.zeros((height, width + 1), dtype=np.intp)
    np.add.at(crossings, (rows, columns), 1)
    covers: BoolArray = np.cumsum(crossings[:, :width], axis=1) % 2 == 1
    return covers


def _rings(mask: BoolArray) -> list[Float64Array]:
    """The border of each part and of each hole, as pixels of the mask (n, 2) in order; none is repeated at the end."""
    levels = np.pad(mask, 1).astype(np.float64)
    # At this level the lines pass just outside the middle of the mask's pixels.
    generator = contour_generator(z=levels, fill_type=FillType.OuterOffset)
    filled = cast("tuple[list[Float64Array], list[IndexArray]]", generator.filled(0.999, 2.0))
    rings = []
    for points, starts in zip(*filled, strict=True):
        for start, end in pairwise(starts.tolist()):
            pixels = np.round(points[start : end - 1]) - 1.0
            moved = (pixels != np.roll(pixels, 1, axis=0)).any(axis=1)
            rings.append(pixels[moved] if moved.any() else pixels[:1])
    return rings


def _simplified(ring: Float64Array) -> Float64Array:
    if len(ring) < 4:
        return ring
    closed = shapely.linestrings(np.vstack([ring, ring[:1]]))
    return shapely.get_coordinates(shapely.simplify(closed, TOLERANCE_PX, preserve_topology=False))[:-1]


def _bridges(rings: list[Float64Array]) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """The shortest tree that joins all rings to the first: ring and point → the rings and points joined to it."""
    points = np.vstack(rings)
    ring = np.repeat(np.arange(len(rings)), [len(each) for each in rings])
    within = np.arange(len(points)) - np.flatnonzero(np.diff(ring, prepend=-1))[ring]
    nearest, distance = np.zeros(len(points), dtype=np.intp), np.full(len(points), np.inf)
    joined: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    added = 0
    for _ in range(len(rings) - 1):
        mine = np.flatnonzero(ring == added)
        distance[mine] = np.nan
        left = np.flatnonzero(~np.isnan(distance))
        from scipy.spatial import KDTree  # a quarter of a second that most masks, which have one part, need not wait

        away, best = KDTree(points[mine]).query(points[left])
        closer = away < distance[left]
        nearest[left[closer]] = mine[best[closer]]
        distance[left[closer]] = away[closer]
        to = int(np.nanargmin(distance))
        joined[int(ring[nearest[to]]), int(within[nearest[to]])].append((int(ring[to]), int(within[to])))
        added = int(ring[to])
    return joined


def _walk(rings: list[Float64Array], bridges: dict[tuple[int, int], list[tuple[int, int]]]) -> Float64Array:
    """Walk once around every ring, over every bridge and back."""
    path: list[Float64Array] = []
    # What is still to do, the next last: go to a point, or from it around its ring.
    todo: list[tuple[int, int, bool]] = [(0, 0, True)]
    while todo:
        ring, point, is_around = todo.pop()
        if is_around:
            size = len(rings[ring])
            steps = [(point + step) % size for step in range(size)] + ([point] if ring else [])
            todo.extend((ring, at, False) for at in reversed(steps[1:]))
            todo.append((ring, point, False))
            continue
        path.append(rings[ring][point])
        for other, start in bridges.pop((ring, point), ()):
            todo.append((ring, point, False))
            todo.append((other, start, True))
    return np.array(path)
