"""One defect of the inventory, from all its observations: place, class, severity and sizes, with their errors.

Errors are standard deviations. A single look has the error of the pixels: half a pixel at each of the edges that a size
runs between, and for areas half a pixel along the edge. Looks are weighted by their errors; what they scatter more than
these explain widens the error of the mean (the Birge ratio of metrology), so that a systematic error of the detector,
which all looks share, is not in it.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon

from pavetwin.detections import SIZES
from pavetwin.inventory.observation import Observation
from pavetwin.inventory.pieces import looks_of

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
    kind: str
    place: Point | None
    """East and north; None where no image says where it was taken."""
    place_error_m: float | None
    """Standard deviation of the place, east and north each."""
    outline: Polygon | None
    """That of the best look."""
    severity: str
    """As `Observation.severity`: what most looks allow."""
    sizes: Mapping[str, SizeEstimate]
    """By names of `SIZES`."""
    is_cut: bool
    """Whether no image shows it whole: its sizes are the least that they can be."""
    confidence: float
    """Of the best look. Looks are no independent chances, so that many do not raise it."""
    looks: int
    """How many images show it."""
    best: Observation
    """The most confident observation, one that shows it whole where there is any."""
    probability: float | None = None
    """That it shows a defect (`pavetwin.inventory.probability`); None where no fitted sensor tells."""


def entry_of(number: int, observations: Sequence[Observation]) -> Entry:
    """The entry of the observations of one defect, at least one; what an image shows in pieces counts as one look."""
    looks = looks_of(observations)
    whole = [each for each in looks if not each.is_cut]
    used = whole or looks
    best = max(used, key=lambda each: each.confidence)
    place, place_error_m = _place(used)
    return Entry(
        number=number,
        kind=best.kind,
        place=place,
        place_error_m=place_error_m,
        outline=best.footprint,
        severity=_severity(used),
        sizes=_sizes(used, is_cut=not whole),
        is_cut=not whole,
        confidence=max(each.confidence for each in observations),
        looks=len(looks),
        best=best,
    )


def _place(observations: Sequence[Observation]) -> tuple[Point | None, float | None]:
    placed = [each for each in observations if each.footprint is not None]
    if not placed:
        return None, None
    centres = np.array([shapely.get_coordinates(each.footprint.centroid)[0] for each in placed if each.footprint])
    errors = np.array([hypot(each.position_error_m, each.pixel_m or 0.0) or _LEAST_M for each in placed])
    sides = [_combined(centres[:, axis], errors) for axis in (0, 1)]
    return Point(sides[0].value, sides[1].value), max(side.error for side in sides)


_LEAST_M: Final = 0.01
"""Error of a place whose pixel is not known."""


def _sizes(observations: Sequence[Observation], *, is_cut: bool) -> Mapping[str, SizeEstimate]:
    found = {}
    for name in SIZES:
        looks = [(each.sizes[name], _size_error(each, name)) for each in observations if name in each.sizes]
        if not looks:
            continue
        values, errors = np.array(looks).T
        largest = int(values.argmax())
        cut = SizeEstimate(float(values[largest]), float(errors[largest]))
        found[name] = cut if is_cut else _combined(values, errors)
    return found


def _size_error(observation: Observation, name: str) -> float:
    """In the unit of the size."""
    pixel_m = observation.pixel_m or _LEAST_M
    if name != "area_m2":
        return pixel_m / sqrt(2) * (1000.0 if name.endswith("_mm") else 1.0)
    length = observation.sizes.get("length_m")
    edge_m = 2 * length if length else 4 * sqrt(observation.sizes[name])
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


def _severity(observations: Sequence[Observation]) -> str:
    """The range of severities that most looks allow; empty where that says nothing."""
    votes: Counter[str] = Counter()
    for each in observations:
        votes.update(_range(each.severity))
    if not votes:
        return ""
    most = max(votes.values())
    allowed = [severity for severity in SEVERITIES if votes[severity] == most]
    if allowed[0] == SEVERITIES[0] and allowed[-1] == SEVERITIES[-1]:
        return ""
    return allowed[0] if len(allowed) == 1 else f"{allowed[0]} to {allowed[-1]}"


def _range(severity: str) -> tuple[str, ...]:
    ends = [SEVERITIES.index(word) for word in severity.split(" to ") if word in SEVERITIES]
    return SEVERITIES[min(ends) : max(ends) + 1] if ends else ()
