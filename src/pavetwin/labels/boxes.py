"""Boxes in an image, in whole pixels: left, top, and the first column and row beyond."""

from math import floor
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array

PixelBox = tuple[int, int, int, int]
"""Left, top, right, bottom in pixels; right and bottom are exclusive."""

FloatBox = tuple[float, float, float, float]
"""The same edges where they may fall within a pixel, as label files have them."""

NO_SHARE: Final = 0.0


def area(box: FloatBox | PixelBox) -> float:
    """In square pixels; 0 where it has no extent."""
    return max(0.0, box[2] - box[0]) * max(0.0, box[3] - box[1])


def corners(box: FloatBox) -> Float64Array:
    """(4, 2) Corners of a box, from the upper left one clockwise."""
    left, top, right, bottom = box
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def ordered(box: FloatBox) -> FloatBox:
    """The box between two opposite corners, in whichever order they are given."""
    left, right = sorted((box[0], box[2]))
    top, bottom = sorted((box[1], box[3]))
    return left, top, right, bottom


def within(box: FloatBox, window: FloatBox) -> FloatBox | None:
    """The part of a box in a window, both in the same frame; None where they share no area."""
    left, top = max(box[0], window[0]), max(box[1], window[1])
    right, bottom = min(box[2], window[2]), min(box[3], window[3])
    return (left, top, right, bottom) if left < right and top < bottom else None


def share_within(box: FloatBox, window: FloatBox) -> float:
    """Share of a box's area that lies in a window, 0 … 1."""
    inside = within(box, window)
    return area(inside) / area(box) if inside is not None else NO_SHARE


def scaled(box: FloatBox, across: float, down: float) -> FloatBox:
    """The box in an image that was resized by these factors."""
    return box[0] * across, box[1] * down, box[2] * across, box[3] * down


def moved(box: FloatBox, right: float, down: float) -> FloatBox:
    return box[0] + right, box[1] + down, box[2] + right, box[3] + down


def flipped(box: PixelBox, width: int) -> PixelBox:
    """The box in an image of this width whose left and right were exchanged."""
    return width - box[2], box[1], width - box[0], box[3]


def ends_at_border(box: FloatBox, size_px: tuple[int, int], within_px: float = 1.5) -> bool:
    """Whether a box ends so near to the border of an image of (width, height) that what is in it may go on beyond."""
    near = min(box[0], box[1]) < within_px
    return near or box[2] > size_px[0] - within_px or box[3] > size_px[1] - within_px


def of_mask(mask: BoolArray) -> PixelBox | None:
    """The smallest box around a mask (height, width); None where it is empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def to_pixels(box: FloatBox, size_px: tuple[int, int]) -> PixelBox | None:
    """The nearest box of whole pixels in an image of (width, height), at least one pixel wide and high.

    Returns:
        None where the box has no area within the image.
    """
    width, height = size_px
    inside = within(box, (0.0, 0.0, float(width), float(height)))
    if inside is None:
        return None
    left, right = _whole(inside[0], inside[2], width)
    top, bottom = _whole(inside[1], inside[3], height)
    return left, top, right, bottom


def _whole(start: float, end: float, limit: int) -> tuple[int, int]:
    """The nearest whole numbers within 0 … limit, at least one apart: where both round to one, the pixel of the
    middle."""
    first, last = floor(start + 0.5), floor(end + 0.5)
    if first == last:
        first = min(floor((start + end) / 2), limit - 1)
        last = first + 1
    return first, last
