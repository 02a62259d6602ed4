"""What is taken for what: the confusion matrix with background, and the subtypes of defects."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Int64Array
from pavetwin.labels.boxes import FloatBox, area, within
from pavetwin.perception.classes import CLASSES, ROAD_DEFECT, SUBTYPES
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage
from pavetwin.training.evaluation.matching import HALF, Matched

BACKGROUND: Final = len(CLASSES)
"""The last row of a matrix: detections where nothing is; and its last column: objects that were missed."""

_OVERLAP: Final = 0.5


@dataclass(frozen=True, slots=True)
class SubtypeScores:
    """How well the subtypes of regions that hold a defect are told apart."""

    counts: Int64Array
    """(subtypes, subtypes) regions, by true and by said subtype."""

    @property
    def regions(self) -> int:
        return int(self.counts.sum())

    @property
    def accuracy(self) -> float | None:
        return float(np.trace(self.counts)) / self.regions if self.regions else None

    @property
    def f1(self) -> tuple[float | None, ...]:
        """Of each subtype; None of one that is neither true nor said."""
        whole = self.counts.sum(axis=0) + self.counts.sum(axis=1)
        hits = np.diag(self.counts)
        return tuple(float(2 * hit / total) if total else None for hit, total in zip(hits, whole, strict=True))

    @property
    def macro_f1(self) -> float | None:
        """Over the subtypes that some region has."""
        there = self.counts.sum(axis=1) > 0
        values = [value or 0.0 for value, counts in zip(self.f1, there, strict=True) if counts]
        return sum(values) / len(values) if values else None


def subtypes_of_matched(coarse: Matched, confidence: float) -> SubtypeScores:
    """On predicted regions: detections of Road Defect that are at least so confident, each matched at IoU 0.5 to a
    defect of a known subtype.

    Args:
        coarse: matched over the coarse classes.
    """
    true = {region.number: region for image in coarse.images for region in image.regions}
    defects = coarse.classes[ROAD_DEFECT]
    pairs = []
    for number, at, told in zip(defects.true_number, defects.true_found, defects.true_confidence, strict=True):
        region = true[int(number)]
        if at >= 0 and told >= confidence and region.has_subtype:
            pairs.append((region.true.subtype, coarse.found[int(at)].number_of_class))
    return _counted(pairs)


def subtypes_of_true(images: tuple[LabelledImage, ...], told: Mapping[int, int]) -> SubtypeScores:
    """On true regions.

    Args:
        told: number of the annotation → what was said.
    """
    regions = (region for image in images for region in image.regions if region.number in told)
    return _counted((region.true.subtype, told[region.number]) for region in regions)


def _counted(pairs: Iterable[tuple[int, int]]) -> SubtypeScores:
    counts = np.zeros((len(SUBTYPES), len(SUBTYPES)), dtype=np.int64)
    for pair in pairs:
        counts[pair] += 1
    return SubtypeScores(counts)


def confusion_matrix(five: Matched, confidence: float) -> Int64Array:
    """(6, 6) true class × said class, `BACKGROUND` last, at IoU 0.5.

    From the most confident on, each detection takes the free object that it overlaps most, whatever its class. One that
    overlaps nothing but an ignored region, of which it may be a part, is not counted.
    """
    counts = np.zeros((BACKGROUND + 1, BACKGROUND + 1), dtype=np.int64)
    said: dict[int, list[FoundBox]] = {image.number: [] for image in five.images}
    for each in _counting(five, confidence):
        said[each.image].append(each)
    for image in five.images:
        _count_image(image, said[image.number], counts)
    return counts


def _counting(five: Matched, confidence: float) -> list[FoundBox]:
    """Detections by falling confidence, without those that the protocol leaves out."""
    found = []
    for each in five.classes:
        used = (each.confidence >= confidence) & ~each.left_out[HALF]
        found += [five.found[at] for at in each.found[used].tolist()]
    return sorted(found, key=lambda box: -box.confidence)


def _count_image(image: LabelledImage, said: list[FoundBox], counts: Int64Array) -> None:
    free = [region for region in image.regions if not region.true.is_ignored and region.number_of_class is not None]
    for box in said:
        overlaps = [overlap(box.box, region.true.box) for region in free]
        best = int(np.argmax(overlaps)) if overlaps else -1
        row = BACKGROUND
        if best >= 0 and overlaps[best] >= _OVERLAP:
            true = free.pop(best).number_of_class
            assert true is not None
            row = true
        counts[row, box.number_of_class] += 1
    for region in free:
        true = region.number_of_class
        assert true is not None
        counts[true, BACKGROUND] += 1


def overlap(one: FloatBox, other: FloatBox) -> float:
    """Intersection over union of two boxes; 0 where neither has area."""
    inside = within(one, other)
    if inside is None:
        return 0.0
    shared = area(inside)
    return shared / (area(one) + area(other) - shared)
