"""Precision, recall and F1 at a confidence, and the confidence at which F1 is best; IoU 0.5."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array
from pavetwin.training.evaluation.matching import HALF, Matched, MatchedClass

RECALLS: Final = np.linspace(0.0, 1.0, 101)
"""Recall levels at which precision is read."""


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
        """None where nothing was said."""
        said = self.hits + self.false_alarms
        return self.hits / said if said else None

    @property
    def recall(self) -> float | None:
        """None where there is no object."""
        return self.hits / self.objects if self.objects else None

    @property
    def f1(self) -> float | None:
        """None where there is no object."""
        return 2 * self.hits / (self.hits + self.false_alarms + self.objects) if self.objects else None


@dataclass(frozen=True, slots=True)
class ScoresAt:
    """What a detector reaches at a confidence. Means are over the classes that have objects."""

    confidence: float
    classes: tuple[ClassScores, ...]

    @property
    def precision(self) -> float | None:
        """A class of which nothing was said counts as 0."""
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
    where nothing that is said is right.

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
    said = np.concatenate([[0], np.cumsum(kept)])[used]
    return np.asarray(2 * hits / (said + each.objects), dtype=np.float64)


def weighted_precision(each: MatchedClass, weights: Float64Array, thresholds: slice = slice(None)) -> Float64Array:
    """(thresholds,) average precision where image i is there `weights[i]` times; NaN where no object is left.

    With weights of 1 it is what pycocotools says.
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
    said = np.cumsum(np.where(skipped, 0.0, weight))[hit]
    if not len(found):
        return 0.0
    # Between two hits precision only falls, so that its greatest values beyond a recall are at hits.
    envelope = np.maximum.accumulate((found / said)[::-1])[::-1]
    at = np.searchsorted(found / objects, RECALLS, side="left")
    return float(np.append(envelope, 0.0)[at].mean())
