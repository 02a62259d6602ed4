"""Average precision by the COCO protocol, with NumPy alone: what training follows on the validation images.

Detections are matched from the most confident on, each to the free true object that it overlaps most, at IoU thresholds
from 0.50 to 0.95. A detection that matches nothing but an ignored region is left out; for such a region the overlap is
a share of the detection's own area. Precision is read at 101 levels of recall (Lin et al. 2014, and its published
evaluation).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.perception.box_pairs import areas, shared_areas

THRESHOLDS: Final = np.linspace(0.5, 0.95, 10)
RECALLS: Final = np.linspace(0.0, 1.0, 101)
MOST_DETECTIONS: Final = 100
"""Of a class in an image, the most confident ones."""


@dataclass(frozen=True, slots=True)
class Scored:
    """What is said of an image, and what is true of it. Boxes are left, top, right, bottom."""

    boxes: Float64Array
    """(detections, 4)"""
    classes: IndexArray
    """(detections,)"""
    confidence: Float64Array
    """(detections,)"""
    true_boxes: Float64Array
    """(objects, 4)"""
    true_classes: IndexArray
    """(objects,)"""
    ignored: BoolArray
    """(objects,)"""


def average_precision(images: Sequence[Scored], classes: int) -> Float64Array:
    """(classes, thresholds) in 0 … 1; NaN for a class of which there is no object."""
    return np.array([_of_class(images, number) for number in range(classes)])


def _of_class(images: Sequence[Scored], number: int) -> Float64Array:
    matched, left_out, confidence, objects = [], [], [], 0
    for image in images:
        mine = np.flatnonzero(image.classes == number)
        mine = mine[np.argsort(-image.confidence[mine], kind="stable")][:MOST_DETECTIONS]
        true = image.true_classes == number
        found = _match(image.boxes[mine], image.true_boxes[true], image.ignored[true])
        matched.append(found[0])
        left_out.append(found[1])
        confidence.append(image.confidence[mine])
        objects += int((true & ~image.ignored).sum())
    if not objects:
        return np.full(len(THRESHOLDS), np.nan)
    order = np.argsort(-np.concatenate(confidence), kind="stable")
    hits, out = np.hstack(matched)[:, order], np.hstack(left_out)[:, order]
    return np.array([_area(row[~skipped], objects) for row, skipped in zip(hits, out, strict=True)])


def _match(boxes: Float64Array, true: Float64Array, ignored: BoolArray) -> tuple[BoolArray, BoolArray]:
    """(thresholds, detections) whether each is a hit, and whether it is left out."""
    hits = np.zeros((len(THRESHOLDS), len(boxes)), dtype=np.bool_)
    out = np.zeros_like(hits)
    if not len(true):
        return hits, out
    overlap = _overlap(boxes, true, ignored)
    free = np.tile(~ignored, (len(THRESHOLDS), 1))
    each = np.arange(len(THRESHOLDS))
    for detection in range(len(boxes)):
        enough = overlap[detection] >= THRESHOLDS[:, None]
        open_to_it = np.where(free & enough, overlap[detection], -1.0)
        # Of equal overlaps the last, as the published evaluation has it.
        best = len(true) - 1 - np.argmax(open_to_it[:, ::-1], axis=1)
        is_hit = open_to_it[each, best] >= 0
        hits[:, detection] = is_hit
        free[each[is_hit], best[is_hit]] = False
        out[:, detection] = ~is_hit & (enough & ignored).any(axis=1)
    return hits, out


def _overlap(boxes: Float64Array, true: Float64Array, ignored: BoolArray) -> Float64Array:
    """(detections, objects) IoU; for ignored objects the intersection as a share of the detection."""
    inner, own = shared_areas(boxes, true), areas(boxes)[:, None]
    whole = np.where(ignored, own, own + areas(true) - inner)
    return np.asarray(inner / np.maximum(whole, np.finfo(np.float64).tiny))


def _area(hits: BoolArray, objects: int) -> float:
    """Under the curve of precision over recall, of detections from the most confident on."""
    if not len(hits):
        return 0.0
    found = np.cumsum(hits)
    recall, precision = found / objects, found / np.arange(1, len(hits) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    at = np.searchsorted(recall, RECALLS, side="left")
    return float(np.append(envelope, 0.0)[at].mean())
