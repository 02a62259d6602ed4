"""Suppression of boxes by more confident boxes of their class: duplicates of its object, and parts of it.

Non-maximum suppression drops a box only where it is nearly the same as a more confident one. Some of the boxes that it
keeps show an object that was already found, with a box that fits less well; others are objects of their own that stand
close. It also keeps parts, such as a wheel or half of a crack: their overlap with the whole is a small share of the
union.
"""

from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray, Int64Array
from pavetwin.detections import IS_COVERED
from pavetwin.labels.class_names import CLASSES

_SINGLE_CRACK: Final = CLASSES.index("single_crack")


def areas(boxes: Float64Array) -> Float64Array:
    """(n,) Areas of boxes (n, 4): left, top, right, bottom; 0 for a box turned inside out, as an empty overlap is."""
    sides = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0)
    product: Float64Array = sides[:, 0] * sides[:, 1]
    return product


def shared_areas(boxes: Float64Array, others: Float64Array) -> Float64Array:
    """(n, m) Areas that boxes (n, 4) share with others (m, 4)."""
    low = np.maximum(boxes[:, None, :2], others[:, :2])
    high = np.minimum(boxes[:, None, 2:], others[:, 2:])
    product: Float64Array = np.maximum(high - low, 0.0).prod(axis=2)
    return product


SIGMA: Final = 0.5
"""σ of the factor e^(−u² / σ) by which a confidence is multiplied at an IoU of u, as published for Soft-NMS."""


def lowering(boxes: Float32Array, classes: Int64Array) -> Float64Array:
    """(n,) Factors of the confidences of one image's detections, 0 … 1 (Matrix NMS, Wang et al. 2020).

    A factor is the least of f(u) / f(v) over the more confident boxes of the same class, at most 1, with
    f(u) = e^(−u² / σ), u their IoU with the box and v their own greatest IoU with a box more confident than they are:
    a box that is lowered itself lowers others less.

    Args:
        boxes: (n, 4) left, top, right, bottom in pixels, the most confident first.
        classes: (n,) numbers in `CLASSES`.
    """
    others = np.triu(
        _overlaps(boxes.astype(float)) * (classes[:, None] == classes), 1
    )  # rows are the more confident ones
    own = others.max(axis=0, initial=0.0)
    factors: Float64Array = np.exp((own[:, None] ** 2 - others**2) / SIGMA).min(axis=0, where=others > 0, initial=1.0)
    return factors


def _overlaps(boxes: Float64Array) -> Float64Array:
    """(n, n) IoU of each box with each."""
    both, own = shared_areas(boxes, boxes), areas(boxes)
    iou: Float64Array = both / np.maximum(own[:, None] + own - both, 1e-9)
    return iou


WITHIN: Final = 0.9
"""Share of a box within a more confident box of its class from which it is a part of that object."""

COVERED: Final = 0.7
"""The same for two single cracks, between the cells of their masks: the box of a slanting crack may hold others."""


def whole_objects(boxes: Float32Array, classes: Int64Array, masks: Float32Array | None) -> IndexArray:
    """Rows of one image's detections that are not parts of a more confident one of the same class.

    Args:
        boxes: (n, 4) left, top, right, bottom in pixels, the most confident first.
        classes: (n,) numbers in `CLASSES`.
        masks: (n, cells, cells) of defects within their boxes, 0 … 1; without them single cracks are all kept.
    """
    is_part = (_shares(boxes.astype(float)) >= WITHIN) & (classes[:, None] == classes)
    for part, whole in np.argwhere(np.tril(is_part, -1) & (classes == _SINGLE_CRACK)).tolist():
        is_part[part, whole] = masks is not None and _covered(boxes, masks, part, whole) >= COVERED
    is_kept = np.zeros(len(boxes), dtype=bool)
    for row in range(len(boxes)):
        is_kept[row] = not (is_part[row, :row] & is_kept[:row]).any()
    return np.flatnonzero(is_kept)


def _shares(boxes: Float64Array) -> Float64Array:
    """(n, n) Share of each box within each other."""
    shares: Float64Array = shared_areas(boxes, boxes) / np.maximum(areas(boxes), 1e-9)[:, None]
    return shares


def _covered(boxes: Float32Array, masks: Float32Array, part: int, whole: int) -> float:
    """Share of the cells of a part's mask whose centres the mask of the whole covers; 0 for an empty mask."""
    rows, columns = np.nonzero(masks[part] >= IS_COVERED)
    if not len(rows):
        return 0.0
    cells = np.array(masks.shape[:0:-1], dtype=float)
    corner, sides = boxes[part, :2], boxes[part, 2:] - boxes[part, :2]
    centres = corner + (np.stack([columns, rows], axis=1) + 0.5) * sides / cells
    places = np.floor((centres - boxes[whole, :2]) * cells / (boxes[whole, 2:] - boxes[whole, :2])).astype(int)
    inside = ((places >= 0) & (places < cells)).all(axis=1)
    at = places[inside]
    hit: BoolArray = masks[whole][at[:, 1], at[:, 0]] >= IS_COVERED
    return float(hit.sum() / len(rows))
