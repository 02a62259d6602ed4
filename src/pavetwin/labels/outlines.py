"""Masks as one polygon each, for label files that know nothing else."""

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
    join all of them (Prim 1957). Filled by the even-odd rule, border included, it is the mask again, but for bridges
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
        away = np.square(points[left, None] - points[None, mine]).sum(axis=-1)
        best = away.argmin(axis=1)
        closer = away[np.arange(len(left)), best] < distance[left]
        nearest[left[closer]] = mine[best[closer]]
        distance[left[closer]] = away[closer, best[closer]]
        to = int(np.nanargmin(distance))
        joined[int(ring[nearest[to]]), int(within[nearest[to]])].append((int(ring[to]), int(within[to])))
        added = int(ring[to])
    return joined


def _walk(rings: list[Float64Array], bridges: dict[tuple[int, int], list[tuple[int, int]]]) -> Float64Array:
    """Once around every ring, over every bridge and back."""
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
