"""Errors of the sizes that a detector gives, against those that captures know."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.perception.classes import SIZES
from pavetwin.perception.evaluation.matching import Matched

WHOLE: Final = 0.99
"""A defect counts where so much of it lies within the image, and so much of that is seen: its true size is that of all
of it."""


@dataclass(frozen=True, slots=True)
class SizeError:
    """Of one size, over defects of one class that are found whole."""

    size: str
    name: str
    """Of the class."""
    defects: int
    mean_absolute_percentage: float
    bias_percentage: float
    """The mean of (said − true) / true; above 0 where sizes are too large."""


def size_errors(five: Matched, confidence: float) -> list[SizeError]:
    """A row for each size and class with defects whose true and said size are known, matched at IoU 0.5."""
    regions = {region.number: region for image in five.images for region in image.regions}
    rows = []
    for size in SIZES:
        for each in five.classes:
            errors = []
            for number, at, told in zip(each.true_number, each.true_found, each.true_confidence, strict=True):
                true = regions[int(number)].facts
                if at < 0 or told < confidence or not is_whole(true) or true.get(size, 0.0) <= 0:
                    continue
                said = five.found[int(at)].sizes
                if size in said:
                    errors.append(100 * (said[size] / true[size] - 1))
            if errors:
                rows.append(
                    SizeError(size, each.name, len(errors), float(np.abs(errors).mean()), float(np.mean(errors)))
                )
    return rows


def is_whole(facts: Mapping[str, float]) -> bool:
    """Whether a defect lies wholly in its image and is wholly seen, as far as its label says."""
    return all(facts.get(name, 0.0) >= WHOLE for name in ("visible_fraction", "inside_fraction"))
