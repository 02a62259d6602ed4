"""From deduct values to the Pavement Condition Index (ASTM D6433, section 9.5)."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from math import floor
from typing import Final

from pavetwin.defects.severity import Distress
from pavetwin.pci.curves import corrected_deduct_value
from pavetwin.world.model import Severity

NEGLIGIBLE: Final = 2.0
"""Deduct values up to this do not count in q, and larger ones are reduced to it one by one."""


class Rating(StrEnum):
    """The standard's words for a condition index."""

    GOOD = "good"
    SATISFACTORY = "satisfactory"
    FAIR = "fair"
    POOR = "poor"
    VERY_POOR = "very poor"
    SERIOUS = "serious"
    FAILED = "failed"


RATINGS: Final = (
    (85.0, Rating.GOOD),
    (70.0, Rating.SATISFACTORY),
    (55.0, Rating.FAIR),
    (40.0, Rating.POOR),
    (25.0, Rating.VERY_POOR),
    (10.0, Rating.SERIOUS),
    (0.0, Rating.FAILED),
)
"""Each from this index on."""


@dataclass(frozen=True, slots=True)
class Deduct:
    """Deduct value of one distress of one severity in a sample unit."""

    distress: Distress
    severity: Severity
    quantity: float
    """In the distress's unit: m², m or number."""
    density: float
    """Quantity over the unit's area [%]."""
    value: float


def rating_of(pci: float) -> Rating:
    """The words for an index.

    Raises:
        ValueError: it is not within 0 to 100.
    """
    if not 0.0 <= pci <= 100.0:
        raise ValueError(f"a condition index of {pci} is not within 0 to 100")
    return next(rating for least, rating in RATINGS if pci >= least)


def pavement_condition_index(deduct_values: Iterable[float]) -> float:
    """The index, 0 (failed) to 100 (without distress), of a sample unit with these deduct values.

    PCI = 100 − max CDV. Of the deduct values the largest m = 1 + (9/98)(100 − HDV) ≤ 10 are kept, HDV being the highest
    and of the last one only the fraction of m. The corrected deduct value (CDV) of their total is read for the number q
    of values above 2; then the smallest of these becomes 2, until one is left. With at most one value above 2 the
    total itself is the CDV.
    """
    values = sorted(deduct_values, reverse=True)
    if not values:
        return 100.0
    kept = _allowed(values)
    q = sum(value > NEGLIGIBLE for value in kept)
    if q <= 1:
        return max(0.0, 100.0 - sum(kept))
    corrected = []
    while q >= 1:
        corrected.append(corrected_deduct_value(sum(kept), q))
        kept[q - 1] = NEGLIGIBLE
        q -= 1
    return max(0.0, 100.0 - max(corrected))


def allowed_number(highest: float) -> float:
    """The number m of deduct values that count, from the highest."""
    return min(10.0, 1.0 + 9.0 / 98.0 * (100.0 - highest))


def _allowed(values: list[float]) -> list[float]:
    """The m largest of values in descending order; the last one is scaled by the fraction of m."""
    number = allowed_number(values[0])
    whole = floor(number)
    kept = values[:whole]
    return [*kept, values[whole] * (number - whole)] if len(values) > whole and number > whole else kept
