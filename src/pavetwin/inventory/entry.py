"""One defect of the inventory, from all its detections: place, class, severity and sizes, with their errors.

Errors are standard deviations. A single look has the error of the pixels: half a pixel at each of the edges that a size
runs between, and for areas half a pixel along the edge. Looks are weighted by their errors; what they scatter more than
these explain widens the error of the mean (the Birge ratio of metrology), so that a systematic error of the detector,
which all looks share, is not in it.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon

from pavetwin.detections import SEVERITY_RANGE, SIZES, Detections, possible_severities
from pavetwin.inventory.merging import looks_of

SEVERITIES: Final = ("low", "medium", "high")


@dataclass(frozen=True, slots=True)
class SizeEstimate:
    """A value and its standard deviation."""

    value: float
    error: float


@dataclass(frozen=True)
class Entry:
    """One defect."""

    number: int
    """From 1."""
    class_name: str
    place: Point | None
    """East and north; None where no image says where it was taken."""
    place_error_m: float | None
    """Standard deviation of the place, east and north each."""
    outline: Polygon | None
    """That of the best look."""
    severity: str
    """Severity or range that most looks allow; empty where the images show none."""
    sizes: Mapping[str, SizeEstimate]
    """By names of `SIZES`."""
    is_cut: bool
    """Whether no image shows it whole: its sizes are the least that they can be."""
    confidence: float
    """Of the best look. Looks are no independent chances, so that many do not raise it."""
    looks: int
    """How many images show it."""
    best: Detections
    """Its most confident detection, a whole one where there is any: a record of one row."""
    probability: float | None = None
    """That it shows a defect (`pavetwin.inventory.probability`); None where no fitted sensor tells."""


def entry_of(number: int, detections: Detections) -> Entry:
    """The entry of the detections of one defect, at least one; pieces in one image count as one look."""
    looks = looks_of(detections)
    whole = looks[~looks.is_cut]
    used = whole if len(whole) else looks
    best = used[[int(np.argmax(used.confidence))]]
    place, place_error_m = _place(used)
    return Entry(
        number=number,
        class_name=best.class_name[0],
        place=place,
        place_error_m=place_error_m,
        outline=best.footprint[0],
        severity=_severity(used),
        sizes=_sizes(used, is_cut=not len(whole)),
        is_cut=not len(whole),
        confidence=float(detections.confidence.max()),
        looks=len(looks),
        best=best,
    )


def _place(looks: Detections) -> tuple[Point | None, float | None]:
    placed = looks[[outline is not None for outline in looks.footprint]]
    if not len(placed):
        return None, None
    centres = shapely.get_coordinates(shapely.centroid(placed.footprint))
    pixels_m = np.nan_to_num(placed.pixel_mm / 1000)
    errors = np.array(
        [hypot(error, pixel) or _LEAST_M for error, pixel in zip(placed.position_error_m, pixels_m, strict=True)]
    )
    sides = [_combined(centres[:, axis], errors) for axis in (0, 1)]
    return Point(sides[0].value, sides[1].value), max(side.error for side in sides)


_LEAST_M: Final = 0.01
"""Error of a place whose pixel is not known."""


def _sizes(looks: Detections, *, is_cut: bool) -> Mapping[str, SizeEstimate]:
    found = {}
    for name in SIZES:
        rows = np.flatnonzero(~np.isnan(getattr(looks, name)))
        if not len(rows):
            continue
        values = getattr(looks, name)[rows]
        errors = np.array([_size_error(looks, row, name) for row in rows.tolist()])
        largest = int(values.argmax())
        cut = SizeEstimate(float(values[largest]), float(errors[largest]))
        found[name] = cut if is_cut else _combined(values, errors)
    return found


def _size_error(looks: Detections, row: int, name: str) -> float:
    """Standard deviation in the unit of the size."""
    pixel_mm = float(looks.pixel_mm[row])
    pixel_m = _LEAST_M if np.isnan(pixel_mm) else pixel_mm / 1000
    if name != "area_m2":
        return pixel_m / sqrt(2) * (1000.0 if name.endswith("_mm") else 1.0)
    length = float(looks.length_m[row])
    edge_m = 4 * sqrt(looks.area_m2[row]) if np.isnan(length) or not length else 2 * length
    return 0.5 * pixel_m * edge_m


def _combined(values: np.ndarray, errors: np.ndarray) -> SizeEstimate:
    """The mean weighted by the inverse variances, its error times the Birge ratio where that is above 1."""
    weights = 1 / errors**2
    mean = float((weights * values).sum() / weights.sum())
    error = 1 / sqrt(float(weights.sum()))
    if len(values) > 1:
        chi2 = float((weights * (values - mean) ** 2).sum())
        error *= max(1.0, sqrt(chi2 / (len(values) - 1)))
    return SizeEstimate(mean, error)


def _severity(looks: Detections) -> str:
    """The range of severities that most looks allow; empty where all are possible."""
    votes: Counter[str] = Counter()
    for each in looks.severity:
        votes.update(_range(each))
    if not votes:
        return ""
    most = max(votes.values())
    allowed = [severity for severity in SEVERITIES if votes[severity] == most]
    if allowed[0] == SEVERITIES[0] and allowed[-1] == SEVERITIES[-1]:
        return ""
    return allowed[0] if len(allowed) == 1 else f"{allowed[0]}{SEVERITY_RANGE}{allowed[-1]}"


def _range(severity: str) -> tuple[str, ...]:
    ranks = possible_severities(severity) or ()
    return tuple(SEVERITIES[rank] for rank in ranks)
