"""Sizes of a defect from its mask and the ground resolution."""

from collections.abc import Mapping
from math import isfinite, pi, sqrt
from typing import Final, Literal

import cv2
import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.errors import PaveTwinError
from pavetwin.perception.classes import CRACKS

NOT_RESOLVABLE: Final = "not resolvable"

LEAST_PX: Final = 2.0
"""A size below it is not given."""

Measure = float | Literal["not resolvable"]
"""A size, or that the picture does not show it."""


def check_size(name: str, value: float, *, may_be_zero: bool = False) -> None:
    """Refuse what is no size.

    Args:
        name: of the parameter.

    Raises:
        PaveTwinError: it is negative, not a finite number, or 0 where it may not be.
    """
    if not isfinite(value):
        raise PaveTwinError(f"`{name}` {value:g}: it is a finite number.")
    if value < 0 or (value == 0 and not may_be_zero):
        raise PaveTwinError(f"`{name}` {value:g}: it is {'0 or more' if may_be_zero else 'above 0'}.")


def measured(name: str, mask: BoolArray, gsd_mm: float) -> Mapping[str, Measure]:
    """Area of a defect; of a single crack its length and mean width, of others the diameter of a disc of their area.

    Length and width are those of the strip that has the mask's area and perimeter. A network of cracks has no one
    length.

    Args:
        name: of its class.
        mask: (height, width) in pixels.
        gsd_mm: of a pixel.
    """
    pixels = float(np.count_nonzero(mask))
    area = {"area_m2": _told(sqrt(pixels), pixels * gsd_mm**2 / 1e6, 4)}
    if name != CRACKS[0]:
        across = 2 * sqrt(pixels / pi)
        return {**area, "diameter_mm": _told(across, across * gsd_mm, 1)}
    length, width = _strip_px(mask, pixels)
    return {
        **area,
        "length_m": _told(length, length * gsd_mm / 1000, 3),
        "mean_width_mm": _told(width, width * gsd_mm, 1),
    }


def _told(size_px: float, size: float, digits: int) -> Measure:
    return round(size, digits) if size_px >= LEAST_PX else NOT_RESOLVABLE


def _strip_px(mask: BoolArray, pixels: float) -> tuple[float, float]:
    """Length and width of the rectangle of the same area and perimeter; a square where it is rounder than that."""
    rings, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    # A ring passes through the middle of the pixels on the border, which are half a pixel within it.
    half = sum(cv2.arcLength(ring, closed=True) + 4 for ring in rings) / 2
    root = half**2 / 4 - pixels
    if root <= 0:
        return sqrt(pixels), sqrt(pixels)
    return half / 2 + sqrt(root), half / 2 - sqrt(root)
