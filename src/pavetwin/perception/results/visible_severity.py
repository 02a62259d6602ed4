"""Severity after ASTM D6433 as far as a mask tells it, by the classes of `pavetwin.defects.severity`."""

from typing import Final

import cv2
import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.defects.heightfield import Marking
from pavetwin.defects.severity import severities_of_diameter, severity_of_width
from pavetwin.perception.classes import SUBTYPES
from pavetwin.perception.results.measuring import LEAST_PX, NOT_RESOLVABLE
from pavetwin.world.model import Severity

MARGIN_M: Final = Marking().margin_m
"""By which labels, and so masks, are wider than an opening, on each side."""

_ORDER: Final = tuple(Severity)
_BETWEEN: Final = " to "


def visible_severity(name: str, mask: BoolArray, gsd_mm: float, cell_px: float = 1.0) -> str:
    """`low`, `medium`, `high`, or from which to which, as `medium to high`; `not resolvable` where all are possible.

    A crack's opening is its widest place less the margins of labels, give or take two pixels, or two cells of a mask
    that is coarser. A pothole's depth is not seen from above, so all depths are possible. Severity of a crocodile crack
    follows from broken edges, of which a mask says nothing.

    Args:
        name: of its class.
        mask: (height, width) in pixels.
        gsd_mm: of a pixel.
        cell_px: side of a cell that the mask was drawn in.
    """
    pixel_m = gsd_mm / 1000
    error = LEAST_PX * max(1.0, cell_px) * pixel_m
    if name == SUBTYPES[0]:
        opening = _widest_px(mask) * pixel_m - 2 * MARGIN_M
        return _told([severity_of_width(max(0.0, opening - error)), severity_of_width(opening + error)])
    if name == SUBTYPES[2]:
        across = 2 * float(np.sqrt(np.count_nonzero(mask) / np.pi)) * pixel_m - 2 * MARGIN_M
        possible = [each for size in (across - error, across + error) for each in severities_of_diameter(size)]
        return _told(possible)
    return NOT_RESOLVABLE


def possible_ranks(told: str) -> tuple[int, ...] | None:
    """What `visible_severity` leaves possible, as numbers in `Severity`: one, two neighbours, or none where it is not
    resolvable.

    Returns:
        None for other words.
    """
    if told == NOT_RESOLVABLE:
        return ()
    names = [each.value for each in _ORDER]
    parts = told.split(_BETWEEN)
    if any(part not in names for part in parts):
        return None
    ranks = tuple(names.index(part) for part in parts)
    return ranks if len(ranks) == 1 or (len(ranks) == 2 and ranks[1] - ranks[0] == 1) else None


def _widest_px(mask: BoolArray) -> float:
    """From d, the largest distance to a pixel beyond: 2 d − 1 where the width is odd, 2 d where it is even."""
    framed = np.pad(mask.astype(np.uint8), 1)
    return 2 * float(cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).max()) - 0.5


def _told(possible: list[Severity]) -> str:
    ranks = sorted({_ORDER.index(each) for each in possible})
    least, most = _ORDER[ranks[0]], _ORDER[ranks[-1]]
    if least is most:
        return least.value
    return NOT_RESOLVABLE if ranks[-1] - ranks[0] == 2 else f"{least.value}{_BETWEEN}{most.value}"
