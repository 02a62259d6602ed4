"""Results by what is known of images and of objects.

By a property of the image there is average precision, precision and recall. A detection has no visible share and no
contrast, so by properties of objects there is recall alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import inf, sqrt
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray
from pavetwin.labels.boxes import area
from pavetwin.training.evaluation.labelled import LabelledImage, LabelledRegion
from pavetwin.training.evaluation.matching import HALF, Matched
from pavetwin.training.evaluation.scores import weighted_precision


@dataclass(frozen=True, slots=True)
class Known:
    """Something by which results are told apart, in ranges: each from an edge up to the next."""

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
    """Of all classes together; None by properties of objects, and where nothing was said."""
    average_precision: float | None
    """Mean at IoU 0.5 over classes that have objects here; None by properties of objects."""

    @property
    def recall(self) -> float | None:
        """Of all classes together."""
        return self.hits / self.objects if self.objects else None


def breakdowns(five: Matched, confidence: float) -> list[Breakdown]:
    """A row for each property and range of which something is known and there."""
    return [*_by_image(five, confidence), *_by_object(five, confidence)]


def _by_image(five: Matched, confidence: float) -> Iterator[Breakdown]:
    for each in OF_IMAGES:
        values = np.array([image.facts.get(each.name, np.nan) for image in five.images])
        for low, high in each.ranges():
            there = (values >= low) & (values < high)
            if there.any():
                yield _of_images(five, confidence, there, each, (low, high))


def _of_images(five: Matched, confidence: float, there: BoolArray, of: Known, limits: tuple[float, float]) -> Breakdown:
    objects = hits = said = 0
    values = []
    for each in five.classes:
        used = (each.confidence >= confidence) & there[each.image]
        objects += int(there[each.true_image].sum())
        hits += int((each.hit[HALF] & used).sum())
        said += int((used & ~each.left_out[HALF]).sum())
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
        precision=hits / said if said else None,
        average_precision=sum(known) / len(known) if known else None,
    )


def _by_object(five: Matched, confidence: float) -> Iterator[Breakdown]:
    regions = {region.number: (image, region) for image in five.images for region in image.regions}
    objects: list[tuple[LabelledImage, LabelledRegion, bool]] = []
    for each in five.classes:
        for number, told in zip(each.true_number.tolist(), each.true_confidence.tolist(), strict=True):
            objects.append((*regions[number], told >= confidence))
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
