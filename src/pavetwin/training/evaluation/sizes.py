"""Errors of the sizes that a detector gives, against those that captures know."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.perception.classes import SIZES
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledRegion
from pavetwin.training.evaluation.matching import Matched

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
    rows = []
    hits = found_whole(five, confidence)
    for size in SIZES:
        for name, pairs in hits.items():
            errors = [
                100 * (said.sizes[size] / true.facts[size] - 1)
                for true, said in pairs
                if true.facts.get(size, 0.0) > 0 and size in said.sizes
            ]
            if errors:
                rows.append(SizeError(size, name, len(errors), float(np.abs(errors).mean()), float(np.mean(errors))))
    return rows


def found_whole(five: Matched, confidence: float) -> dict[str, list[tuple[LabelledRegion, FoundBox]]]:
    """Name of each class → the whole defects and road users that were found, each with its detection."""
    regions = {region.number: region for image in five.images for region in image.regions}
    hits = {}
    for each in five.classes:
        told = zip(each.true_number, each.true_found, each.true_confidence, strict=True)
        pairs = [
            (regions[int(number)], five.found[int(at)]) for number, at, sure in told if at >= 0 and sure >= confidence
        ]
        hits[each.name] = [(true, said) for true, said in pairs if _is_whole(true.facts)]
    return hits


def _is_whole(facts: Mapping[str, float]) -> bool:
    return all(facts.get(name, 0.0) >= WHOLE for name in ("visible_fraction", "inside_fraction"))
