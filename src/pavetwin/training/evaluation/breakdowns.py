"""Results by properties of images and objects, and errors of the sizes and severities of defects.

By a property of the image there are average precision, precision and recall; by a property of an object only recall,
since a false alarm has no such property."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf, sqrt
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.detections import SIZES, possible_severities
from pavetwin.labels.boxes import area
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledRegion
from pavetwin.training.evaluation.matching import HALF, Matched
from pavetwin.training.evaluation.scores import weighted_precision
from pavetwin.world.model import Severity


@dataclass(frozen=True, slots=True)
class Known:
    """A property by which results are broken down, in ranges between successive edges."""

    name: str
    words: str
    edges: tuple[float, ...]
    unit: str = ""
    percent: bool = False

    def ranges(self) -> list[tuple[float, float]]:
        return list(zip((-inf, *self.edges), (*self.edges, inf), strict=True))

    def text(self, low: float, high: float) -> str:
        factor = 100 if self.percent else 1
        unit = " %" if self.percent else f" {self.unit}" if self.unit else ""
        if low == -inf:
            return f"below {factor * high:g}{unit}"
        return f"from {factor * low:g}{unit}" if high == inf else f"{factor * low:g}–{factor * high:g}{unit}"


OF_IMAGES: Final = (
    Known("altitude_m", "Altitude", (4, 8, 12, 20, 40, 80), "m"),
    Known("gsd_mm", "Ground resolution", (1.5, 3, 4.5, 6, 9, 12, 20), "mm/px"),
    Known("sun_elevation_deg", "Sun's elevation", (15, 30, 45), "°"),
    Known("cloud_cover", "Clouds", (0.2, 0.7), percent=True),
)
"""Clouds in the ranges that captures draw them from: mostly clear, partly cloudy, overcast."""

OF_OBJECTS: Final = (
    Known("size_px", "Size (root of the box's area)", (16, 32, 64, 96, 192), "px"),
    Known("visible_fraction", "Visible share", (0.5, 0.8, 0.99), percent=True),
    Known("contrast", "Contrast of a defect", (20, 35, 60, 120)),
)


@dataclass(frozen=True, slots=True)
class Breakdown:
    """Results of the images, or objects, of one range of a property."""

    name: str
    words: str
    values: str
    low: float
    high: float
    images: int
    objects: int
    hits: int
    """Found at the confidence, IoU 0.5."""
    precision: float | None
    """Precision of all classes together; None for properties of objects, and without detections."""
    average_precision: float | None
    """Mean at IoU 0.5 over classes that have objects here; None by properties of objects."""

    @property
    def recall(self) -> float | None:
        """Recall of all classes together."""
        return self.hits / self.objects if self.objects else None


def breakdowns(five: Matched, confidence: float) -> list[Breakdown]:
    """A row for each property and range with images or objects."""
    return [*_by_image(five, confidence), *_by_object(five, confidence)]


def _by_image(five: Matched, confidence: float) -> Iterator[Breakdown]:
    for each in OF_IMAGES:
        values = np.array([image.facts.get(each.name, np.nan) for image in five.images])
        for low, high in each.ranges():
            there = (values >= low) & (values < high)
            if there.any():
                yield _of_images(five, confidence, there, each, (low, high))


def _of_images(five: Matched, confidence: float, there: BoolArray, of: Known, limits: tuple[float, float]) -> Breakdown:
    objects = hits = reported = 0
    values = []
    for each in five.classes:
        used = (each.confidence >= confidence) & there[each.image]
        objects += int(there[each.true_image].sum())
        hits += int((each.hit[HALF] & used).sum())
        reported += int((used & ~each.left_out[HALF]).sum())
        values.append(weighted_precision(each, there.astype(np.float64), slice(HALF, HALF + 1))[0])
    known = [float(value) for value in values if not np.isnan(value)]
    return Breakdown(
        name=of.name,
        words=of.words,
        values=of.text(*limits),
        low=limits[0],
        high=limits[1],
        images=int(there.sum()),
        objects=objects,
        hits=hits,
        precision=hits / reported if reported else None,
        average_precision=sum(known) / len(known) if known else None,
    )


def _by_object(five: Matched, confidence: float) -> Iterator[Breakdown]:
    regions = {region.number: (image, region) for image in five.images for region in image.regions}
    objects: list[tuple[LabelledImage, LabelledRegion, bool]] = []
    for each in five.classes:
        for number, confident in zip(each.true_number.tolist(), each.true_confidence.tolist(), strict=True):
            objects.append((*regions[number], confident >= confidence))
    for of in OF_OBJECTS:
        values = np.array([_value(of.name)(region) for _, region, _ in objects], dtype=np.float64)
        for low, high in of.ranges():
            there = [each for each, value in zip(objects, values, strict=True) if low <= value < high]
            if there:
                yield Breakdown(
                    name=of.name,
                    words=of.words,
                    values=of.text(low, high),
                    low=low,
                    high=high,
                    images=len({image.number for image, _, _ in there}),
                    objects=len(there),
                    hits=sum(found for _, _, found in there),
                    precision=None,
                    average_precision=None,
                )


def _value(name: str) -> Callable[[LabelledRegion], float]:
    if name == "size_px":
        return lambda region: sqrt(area(region.true.box))
    return lambda region: region.facts.get(name, np.nan)


WHOLE: Final = 0.99
"""A defect counts where so much of it lies within the image, and so much of that is seen: its true size is that of all
of it."""


@dataclass(frozen=True, slots=True)
class SizeError:
    """Error of one size over the defects of one class that are found whole."""

    size: str
    name: str
    """Name of the class."""
    defects: int
    mean_absolute_percentage: float
    bias_percentage: float
    """Mean of (measured − true) / true; positive where sizes are too large."""


def size_errors(five: Matched, confidence: float) -> list[SizeError]:
    """A row for each size and class with defects whose true and measured sizes are known, matched at IoU 0.5."""
    rows = []
    hits = found_whole(five, confidence)
    for size in SIZES:
        for name, pairs in hits.items():
            errors = [
                100 * (found.sizes[size] / true.facts[size] - 1)
                for true, found in pairs
                if true.facts.get(size, 0.0) > 0 and size in found.sizes
            ]
            if errors:
                rows.append(SizeError(size, name, len(errors), float(np.abs(errors).mean()), float(np.mean(errors))))
    return rows


def found_whole(five: Matched, confidence: float) -> dict[str, list[tuple[LabelledRegion, FoundBox]]]:
    """Name of each class → the whole defects and road users that were found, each with its detection."""
    regions = {region.number: region for image in five.images for region in image.regions}
    hits = {}
    for each in five.classes:
        matches = zip(each.true_number, each.true_found, each.true_confidence, strict=True)
        pairs = [
            (regions[int(number)], five.found[int(at)])
            for number, at, sure in matches
            if at >= 0 and sure >= confidence
        ]
        hits[each.name] = [(true, found) for true, found in pairs if _is_whole(true.facts)]
    return hits


def _is_whole(facts: Mapping[str, float]) -> bool:
    return all(facts.get(name, 0.0) >= WHOLE for name in ("visible_fraction", "inside_fraction"))


@dataclass(frozen=True, slots=True)
class SeverityAgreement:
    """Agreement of severities over the defects of one class that are found whole."""

    name: str
    """Name of the class."""
    defects: int
    right: int
    """One severity is stated, and it is the true one."""
    within: int
    """Two severities are stated, as `low to medium`, and one of them is the true one."""
    too_low: int
    """All stated severities are below the true one."""
    too_high: int
    not_resolvable: int


def severity_agreements(five: Matched, confidence: float) -> list[SeverityAgreement]:
    """A row for each class with defects whose true and stated severities are known, matched at IoU 0.5."""
    order = tuple(Severity)
    rows = []
    for name, pairs in found_whole(five, confidence).items():
        right = within = too_low = too_high = not_resolvable = 0
        for region, found in pairs:
            ranks = possible_severities(found.severity)
            if ranks is None or not region.severity:
                continue
            true = order.index(Severity(region.severity))
            not_resolvable += not ranks
            right += ranks == (true,)
            within += len(ranks) == 2 and true in ranks
            too_low += bool(ranks) and max(ranks) < true
            too_high += bool(ranks) and min(ranks) > true
        if defects := right + within + too_low + too_high + not_resolvable:
            rows.append(SeverityAgreement(name, defects, right, within, too_low, too_high, not_resolvable))
    return rows
