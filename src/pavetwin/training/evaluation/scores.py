"""Scores at a confidence, confusion of classes and subtypes, calibration, and average precision of weighted images.

Matches are at IoU 0.5 unless stated otherwise."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.labels.boxes import FloatBox, area, within
from pavetwin.labels.class_names import CLASSES, ROAD_DEFECT, SUBTYPES
from pavetwin.training.evaluation.detections import FoundBox
from pavetwin.training.evaluation.labelled import LabelledImage
from pavetwin.training.evaluation.matching import HALF, Matched, MatchedClass

RECALLS: Final = np.linspace(0.0, 1.0, 101)  # Recall levels at which precision is read


@dataclass(frozen=True, slots=True)
class ClassScores:
    """Counts of one class at a confidence."""

    name: str
    objects: int
    """True ones that count."""
    hits: int
    false_alarms: int

    @property
    def precision(self) -> float | None:
        """None without detections."""
        reported = self.hits + self.false_alarms
        return self.hits / reported if reported else None

    @property
    def recall(self) -> float | None:
        """Recall; None without objects."""
        return self.hits / self.objects if self.objects else None

    @property
    def f1(self) -> float | None:
        """F1; None without objects."""
        return 2 * self.hits / (self.hits + self.false_alarms + self.objects) if self.objects else None


@dataclass(frozen=True, slots=True)
class ScoresAt:
    """Scores of a detector at a confidence. Means are over the classes with objects."""

    confidence: float
    classes: tuple[ClassScores, ...]

    @property
    def precision(self) -> float | None:
        """A class without detections counts as 0."""
        return _mean([each.precision or 0.0 for each in self.classes if each.objects])

    @property
    def recall(self) -> float | None:
        return _mean([each.recall or 0.0 for each in self.classes if each.objects])

    @property
    def f1(self) -> float | None:
        return _mean([each.f1 or 0.0 for each in self.classes if each.objects])


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


def scores_at(matched: Matched, confidence: float) -> ScoresAt:
    """The counts of detections that are at least so confident."""
    return ScoresAt(confidence, tuple(_of_class(each, confidence) for each in matched.classes))


def _of_class(each: MatchedClass, confidence: float) -> ClassScores:
    used = each.confidence >= confidence
    hits = int((each.hit[HALF] & used).sum())
    return ClassScores(each.name, each.objects, hits, int((used & ~each.left_out[HALF]).sum()) - hits)


def best_confidence(matched: Matched) -> float | None:
    """The confidence at which the macro F1 is greatest, the highest of several; None where there is no object, or
    without a correct detection.

    To be chosen on other images than those on which it is then reported.
    """
    tried = np.unique(np.concatenate([each.confidence for each in matched.classes]))
    counted = [each for each in matched.classes if each.objects]
    if not len(tried) or not counted:
        return None
    f1 = np.mean([_f1_at(each, tried) for each in counted], axis=0)
    best = len(tried) - 1 - int(np.argmax(f1[::-1]))
    return float(tried[best]) if f1[best] > 0 else None


def _f1_at(each: MatchedClass, confidences: Float64Array) -> Float64Array:
    kept = ~each.left_out[HALF]
    rising = each.confidence[::-1]
    # How many are at least so confident: they are the first ones.
    used = len(rising) - np.searchsorted(rising, confidences, side="left")
    hits = np.concatenate([[0], np.cumsum(each.hit[HALF])])[used]
    reported = np.concatenate([[0], np.cumsum(kept)])[used]
    return np.asarray(2 * hits / (reported + each.objects), dtype=np.float64)


def weighted_precision(each: MatchedClass, weights: Float64Array, thresholds: slice = slice(None)) -> Float64Array:
    """(thresholds,) average precision where image i is there `weights[i]` times; NaN where no object is left.

    With weights of 1 it equals the result of pycocotools.
    """
    objects = float(weights[each.true_image].sum())
    hits, out = each.hit[thresholds], each.left_out[thresholds]
    if objects == 0:
        return np.full(len(hits), np.nan)
    weight = weights[each.image]
    # Without the images that are not there: they would repeat a precision, or divide by 0.
    there = weight > 0
    return np.array(
        [_area(hit[there], skipped[there], weight[there], objects) for hit, skipped in zip(hits, out, strict=True)]
    )


def _area(hit: BoolArray, skipped: BoolArray, weight: Float64Array, objects: float) -> float:
    found = np.cumsum(np.where(hit, weight, 0.0))[hit]
    reported = np.cumsum(np.where(skipped, 0.0, weight))[hit]
    if not len(found):
        return 0.0
    # Between two hits precision only falls, so that its greatest values beyond a recall are at hits.
    envelope = np.maximum.accumulate((found / reported)[::-1])[::-1]
    at = np.searchsorted(found / objects, RECALLS, side="left")
    return float(np.append(envelope, 0.0)[at].mean())


BINS: Final = 10


@dataclass(frozen=True, slots=True)
class ReliabilityBin:
    """Detections whose confidence lies in a range."""

    low: float
    high: float
    detections: int
    confidence: float | None
    """Their mean; None without any."""
    precision: float | None
    """The share that is right at IoU 0.5."""


@dataclass(frozen=True, slots=True)
class Reliability:
    """Calibration of the detections from a confidence on."""

    least: float
    bins: tuple[ReliabilityBin, ...]

    @property
    def detections(self) -> int:
        return sum(each.detections for each in self.bins)

    @property
    def error(self) -> float | None:
        """Expected calibration error: the mean difference of confidence and precision over detections, bin by bin."""
        if not self.detections:
            return None
        gaps = (
            each.detections * abs(each.confidence - each.precision)
            for each in self.bins
            if each.confidence is not None and each.precision is not None
        )
        return sum(gaps) / self.detections


def reliability(matched: Matched, least: float) -> Reliability:
    """Final confidences in ten equal ranges; detections on ignored regions are not counted.

    Args:
        least: detections below it are not counted.
    """
    kept = [(each.confidence >= least) & ~each.left_out[HALF] for each in matched.classes]
    confidence = np.concatenate([each.confidence[used] for each, used in zip(matched.classes, kept, strict=True)])
    hits = np.concatenate([each.hit[HALF][used] for each, used in zip(matched.classes, kept, strict=True)])
    place = np.minimum((confidence * BINS).astype(np.intp), BINS - 1)
    bins = []
    for at in range(BINS):
        mine = place == at
        count = int(mine.sum())
        bins.append(
            ReliabilityBin(
                at / BINS,
                (at + 1) / BINS,
                count,
                float(confidence[mine].mean()) if count else None,
                float(hits[mine].mean()) if count else None,
            )
        )
    return Reliability(least, tuple(bins))


BACKGROUND: Final = len(CLASSES)
"""The last row of a matrix: detections where nothing is; and its last column: objects that were missed."""

_OVERLAP: Final = 0.5


@dataclass(frozen=True, slots=True)
class SubtypeScores:
    """Classification of the subtypes of regions with a defect."""

    counts: Int64Array
    """(subtypes, subtypes) regions, by true and by reported subtype."""

    @property
    def regions(self) -> int:
        return int(self.counts.sum())

    @property
    def accuracy(self) -> float | None:
        return float(np.trace(self.counts)) / self.regions if self.regions else None

    @property
    def f1(self) -> tuple[float | None, ...]:
        """F1 of each subtype; None for one that is neither true nor reported."""
        whole = self.counts.sum(axis=0) + self.counts.sum(axis=1)
        hits = np.diag(self.counts)
        return tuple(float(2 * hit / total) if total else None for hit, total in zip(hits, whole, strict=True))

    @property
    def macro_f1(self) -> float | None:
        """Mean F1 over the true subtypes."""
        there = self.counts.sum(axis=1) > 0
        values = [value or 0.0 for value, counts in zip(self.f1, there, strict=True) if counts]
        return sum(values) / len(values) if values else None


def subtypes_of_matched(coarse: Matched, confidence: float) -> SubtypeScores:
    """Subtypes of predicted regions: detections of Road Defect from a confidence on, each matched at IoU 0.5 to a
    defect of a known subtype.

    Args:
        coarse: matched over the coarse classes.
    """
    true = {region.number: region for image in coarse.images for region in image.regions}
    defects = coarse.classes[ROAD_DEFECT]
    pairs = []
    for number, at, confident in zip(defects.true_number, defects.true_found, defects.true_confidence, strict=True):
        region = true[int(number)]
        if at >= 0 and confident >= confidence and region.has_subtype:
            pairs.append((region.true.subtype, coarse.found[int(at)].number_of_class))
    return _counted(pairs)


def subtypes_of_true(images: tuple[LabelledImage, ...], reported: Mapping[int, int]) -> SubtypeScores:
    """Subtypes of true regions.

    Args:
        reported: number of the annotation → reported subtype.
    """
    regions = (region for image in images for region in image.regions if region.number in reported)
    return _counted((region.true.subtype, reported[region.number]) for region in regions)


def _counted(pairs: Iterable[tuple[int, int]]) -> SubtypeScores:
    counts = np.zeros((len(SUBTYPES), len(SUBTYPES)), dtype=np.int64)
    for pair in pairs:
        counts[pair] += 1
    return SubtypeScores(counts)


def confusion_matrix(five: Matched, confidence: float) -> Int64Array:
    """(6, 6) true class × reported class, `BACKGROUND` last, at IoU 0.5.

    From the most confident on, each detection takes the free object that it overlaps most, whatever its class. One that
    overlaps nothing but an ignored region, of which it may be a part, is not counted.
    """
    counts = np.zeros((BACKGROUND + 1, BACKGROUND + 1), dtype=np.int64)
    reported: dict[int, list[FoundBox]] = {image.number: [] for image in five.images}
    for each in _counting(five, confidence):
        reported[each.image].append(each)
    for image in five.images:
        _count_image(image, reported[image.number], counts)
    return counts


def _counting(five: Matched, confidence: float) -> list[FoundBox]:
    """Detections by falling confidence, without those that the protocol leaves out."""
    found = []
    for each in five.classes:
        used = (each.confidence >= confidence) & ~each.left_out[HALF]
        found += [five.found[at] for at in each.found[used].tolist()]
    return sorted(found, key=lambda box: -box.confidence)


def _count_image(image: LabelledImage, reported: list[FoundBox], counts: Int64Array) -> None:
    free = [region for region in image.regions if not region.true.is_ignored and region.number_of_class is not None]
    for box in reported:
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
