"""Sizes and visible severity of a defect, from its mask and the ground resolution."""

from math import isfinite, nan, pi, sqrt
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from pavetwin.arrays import BoolArray
from pavetwin.defects.heightfield import Marking
from pavetwin.defects.severity import severities_of_diameter, severity_of_width
from pavetwin.detections import NOT_RESOLVABLE, SEVERITY_RANGE, SIZES, Detections
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import Severity

LEAST_PX: Final = 2.0
"""Pixels below which a size is not resolved."""

MARGIN_M: Final = Marking().margin_m
"""Width by which labels, and so masks, exceed an opening on each side."""

_ORDER: Final = tuple(Severity)


def check_size(name: str, value: float, *, may_be_zero: bool = False) -> None:
    """Refuse a value that is not a size.

    Args:
        name: name of the parameter.

    Raises:
        PaveTwinError: it is negative, not a finite number, or 0 where it may not be.
    """
    if not isfinite(value):
        raise PaveTwinError(f"`{name}` {value:g}: it must be a finite number.")
    if value < 0 or (value == 0 and not may_be_zero):
        raise PaveTwinError(f"`{name}` {value:g}: it must be {'0 or more' if may_be_zero else 'above 0'}.")


def with_sizes(detections: Detections, pixel_mm: npt.ArrayLike) -> Detections:
    """Detections with `pixel_mm`, sizes and visible severity. Rows without a mask or a known pixel have no sizes.

    Args:
        pixel_mm: (n,) side of a pixel on the ground, or one for all rows; NaN where it is not known.
    """
    sides = np.broadcast_to(np.asarray(pixel_mm, dtype=np.float64), (len(detections),))
    rows = [_measured_row(detections, row, float(side)) for row, side in enumerate(sides)]
    columns = {name: [sizes.get(name, nan) for sizes, _ in rows] for name in SIZES}
    return detections.with_columns(pixel_mm=sides, severity=[severity for _, severity in rows], **columns)


def stated_sizes(detections: Detections, row: int) -> dict[str, float | str]:
    """The sizes that apply to the class of a measured detection by name with unit, and its visible severity.

    A size that the image does not resolve is `not resolvable`; a detection that is not measured has none.
    """
    if not detections.severity[row]:
        return {}
    is_strip = detections.class_name[row] == "single_crack"
    names = ("area_m2", "length_m", "mean_width_mm") if is_strip else ("area_m2", "diameter_mm")
    values = {name: float(getattr(detections, name)[row]) for name in names}
    return {
        **{name: NOT_RESOLVABLE if np.isnan(value) else value for name, value in values.items()},
        "severity": detections.severity[row],
    }


def _measured_row(detections: Detections, row: int, pixel_mm: float) -> tuple[dict[str, float], str]:
    """Sizes and visible severity of one detection."""
    mask = None if np.isnan(pixel_mm) else detections.mask_pixels(row)
    if mask is None or not mask[1].any():
        return {}, ""
    cell_px = max(max(part.cell_px) for part in detections.mask[row])
    name, covered = detections.class_name[row], mask[1]
    return measured(name, covered, pixel_mm), visible_severity(name, covered, pixel_mm, cell_px)


def measured(class_name: str, mask: BoolArray, gsd_mm: float) -> dict[str, float]:
    """Area of a defect; of a single crack its length and mean width, of others the diameter of a disc of their area.

    Length and width are those of the strip that has the mask's area and perimeter. A network of cracks has no one
    length. NaN stands for a size that is not resolved.

    Args:
        mask: (height, width) in pixels.
        gsd_mm: side of a pixel on the ground.
    """
    pixels = float(np.count_nonzero(mask))
    area = {"area_m2": _resolved(sqrt(pixels), pixels * gsd_mm**2 / 1e6, 4)}
    if class_name != "single_crack":
        across = 2 * sqrt(pixels / pi)
        return {**area, "diameter_mm": _resolved(across, across * gsd_mm, 1)}
    length, width = _strip_px(mask, pixels)
    return {
        **area,
        "length_m": _resolved(length, length * gsd_mm / 1000, 3),
        "mean_width_mm": _resolved(width, width * gsd_mm, 1),
    }


def _resolved(size_px: float, size: float, digits: int) -> float:
    return round(size, digits) if size_px >= LEAST_PX else nan


def _strip_px(mask: BoolArray, pixels: float) -> tuple[float, float]:
    """Length and width of the rectangle of the same area and perimeter; a square for a rounder mask."""
    rings, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    # A ring passes through the centres of the pixels on the border, which are half a pixel within it.
    half = sum(cv2.arcLength(ring, closed=True) + 4 for ring in rings) / 2
    root = half**2 / 4 - pixels
    if root <= 0:
        return sqrt(pixels), sqrt(pixels)
    return half / 2 + sqrt(root), half / 2 - sqrt(root)


def visible_severity(class_name: str, mask: BoolArray, gsd_mm: float, cell_px: float = 1.0) -> str:
    """`low`, `medium`, `high`, or a range such as `medium to high`; `not resolvable` where all are possible.

    Severity follows ASTM D6433 by the classes of `pavetwin.defects.severity`, as far as a mask shows it. A crack's
    opening is its widest place less the margins of labels, ± two pixels, or ± two cells of a coarser mask. A pothole's
    depth is not visible from above, so all depths are possible. Severity of a crocodile crack follows from broken
    edges, which a mask does not show.

    Args:
        mask: (height, width) in pixels.
        gsd_mm: side of a pixel on the ground.
        cell_px: side of a cell of the mask's grid.
    """
    pixel_m = gsd_mm / 1000
    error = LEAST_PX * max(1.0, cell_px) * pixel_m
    if class_name == "single_crack":
        opening = _widest_px(mask) * pixel_m - 2 * MARGIN_M
        return _range_words([severity_of_width(max(0.0, opening - error)), severity_of_width(opening + error)])
    if class_name == "pothole":
        across = 2 * float(np.sqrt(np.count_nonzero(mask) / np.pi)) * pixel_m - 2 * MARGIN_M
        possible = [each for size in (across - error, across + error) for each in severities_of_diameter(size)]
        return _range_words(possible)
    return NOT_RESOLVABLE


def _widest_px(mask: BoolArray) -> float:
    """Largest width, from d, the largest distance to a pixel outside: between 2 d − 1 (odd widths) and 2 d (even)."""
    framed = np.pad(mask.astype(np.uint8), 1)
    return 2 * float(cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).max()) - 0.5


def _range_words(possible: list[Severity]) -> str:
    ranks = sorted({_ORDER.index(each) for each in possible})
    least, most = _ORDER[ranks[0]], _ORDER[ranks[-1]]
    if least is most:
        return least.value
    return NOT_RESOLVABLE if ranks[-1] - ranks[0] == 2 else f"{least.value}{SEVERITY_RANGE}{most.value}"
