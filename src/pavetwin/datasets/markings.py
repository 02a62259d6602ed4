"""The ground resolution of a picture of a road by the width of its lane lines.

A lane line is `LINE_WIDTH_M` wide here: our assumption. Roads have lines of 0.10 to 0.20 m, so an estimate may be wrong
by a third. What is told from a lane line by its look is left out: bars of a crossing by their neighbours, kerbs and
edges of another surface by what lies on either side.
"""

from dataclasses import dataclass
from math import hypot
from statistics import median
from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt8Array

LINE_WIDTH_M: Final = 0.15

CONTRAST: Final = 0.1
"""Brightness of a lane line above that of the road around, of the full scale."""

FAINT: Final = 0.05
"""The same of what may be a worn bar of a crossing."""

SLENDER: Final = 9.0
"""Length over width, at least: a dash of two metres has 13, a bar of a crossing less."""

LEAST_SHARE: Final = 0.12
"""Length over the picture's longer side, at least."""

BAR_LIKE: Final = 4.0
"""The same of what may be a bar of a crossing."""

STRAIGHT: Final = 0.7
"""Of the smallest rectangle around it that a line fills."""

ALIKE: Final = 0.08
"""Difference of brightness between both sides, at most: a kerb has another surface on one side."""

BARS: Final = 3
"""So many strips beside each other, within `NEARBY` widths, are the bars of a crossing."""

NEARBY: Final = 8.0
PLAUSIBLE_MM: Final = (2.0, 40.0)

_NEAR: Final = 0.2
"""Side of what is around a pixel, of the picture's longer side."""


@dataclass(frozen=True, slots=True)
class _Line:
    middle: Float64Array
    """(2,) column, row."""
    along: Float64Array
    """(2,) of length 1."""
    length: float
    width: float
    contrast: float
    """Brightness above that of the road around, of the full scale."""


def marking_gsd_mm(picture: UInt8Array, road: BoolArray) -> float | None:
    """Millimetres a pixel covers, by the lane lines of a picture (height, width, 3); None where it shows none.

    Args:
        road: (height, width) where it shows road.
    """
    grey = cv2.GaussianBlur(picture.astype(np.float32).mean(axis=2) / 255, (0, 0), 0.8)
    bright, least = _bright_strips(grey), LEAST_SHARE * max(grey.shape)
    widths = [
        line.width
        for line in bright
        if line.contrast >= CONTRAST
        and line.length >= max(SLENDER * line.width, least)
        and _is_on_road(line, grey, road)
        and sum(_is_beside(line, other) for other in bright) < BARS
    ]
    gsd_mm = 1000 * LINE_WIDTH_M / median(widths) if widths else 0.0
    return gsd_mm if PLAUSIBLE_MM[0] <= gsd_mm <= PLAUSIBLE_MM[1] else None


def _bright_strips(grey: Float32Array) -> list[_Line]:
    """All that is straight, longer than wide and brighter than what is around it."""
    height, width = grey.shape
    half = cv2.resize((grey * 255).astype(np.uint8), (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    around = cv2.medianBlur(half, min(round(_NEAR * max(height, width) / 2), 127) | 1)
    above = grey - cv2.resize(around, (width, height)).astype(np.float32) / 255
    parts, _ = ndimage.label(above > FAINT)
    found = []
    for number, place in enumerate(ndimage.find_objects(parts), start=1):
        part = parts[place] == number
        if max(part.shape) < 0.5 * LEAST_SHARE * max(height, width):
            continue
        # Its blurred edges are cut where they are half as bright as the line.
        contrast = float(np.quantile(above[place][part], 0.8))
        part &= above[place] >= 0.5 * contrast
        line = _line(part, (place[1].start, place[0].start), contrast)
        if line.length >= BAR_LIKE * line.width:
            found.append(line)
    return found


def _line(part: BoolArray, corner: tuple[int, int], contrast: float) -> _Line:
    """The smallest rectangle around a part, with the mean width of what fills it; without length where it is bent."""
    points = (np.argwhere(part)[:, ::-1] + np.array(corner)).astype(np.float32)
    (x, y), sides, _ = rectangle = cv2.minAreaRect(points)
    first, second, third = cv2.boxPoints(rectangle)[:3].astype(np.float64)
    side = max(second - first, third - second, key=lambda each: hypot(*each))
    length, across = max(sides) + 1.0, min(sides) + 1.0
    width = len(points) / length
    is_straight = len(points) >= STRAIGHT * length * across
    return _Line(np.array([x, y]), side / max(hypot(*side), 1e-9), length if is_straight else 0.0, width, contrast)


def _is_on_road(line: _Line, grey: Float32Array, road: BoolArray) -> bool:
    """Whether both of its sides are road of one brightness."""
    steps = np.linspace(-0.45, 0.45, 21)[:, None] * line.length * line.along
    normal = np.array([-line.along[1], line.along[0]])
    brightness = []
    for side in (-1.0, 1.0):
        columns, rows = np.rint(line.middle + steps + side * (1.5 * line.width + 2.0) * normal).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < road.shape[1]) & (rows < road.shape[0])
        if inside.mean() < 0.8 or road[rows[inside], columns[inside]].mean() < 0.8:
            return False
        brightness.append(float(np.median(grey[rows[inside], columns[inside]])))
    return abs(brightness[0] - brightness[1]) <= ALIKE


def _is_beside(line: _Line, other: _Line) -> bool:
    """Whether another line, or itself, runs along it nearby."""
    if abs(float(line.along @ other.along)) < 0.97:
        return False
    apart = other.middle - line.middle
    across = abs(float(apart @ np.array([-line.along[1], line.along[0]])))
    return across <= NEARBY * line.width and abs(float(apart @ line.along)) <= 0.5 * line.length
