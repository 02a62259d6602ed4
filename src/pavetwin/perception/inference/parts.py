"""Parts of an object that the network reports beside the whole: a wheel, a windscreen, half of a crack.

Non-maximum suppression keeps them, since a part overlaps the whole by little of their union.
"""

from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, IndexArray, Int64Array
from pavetwin.perception.box_pairs import areas, shared_areas
from pavetwin.perception.classes import SINGLE_CRACK
from pavetwin.perception.inference.detections import IS_COVERED

WITHIN: Final = 0.9
"""Share of a box within a more confident box of its class from which it is a part of that object."""

COVERED: Final = 0.7
"""The same of two single cracks, between what their masks cover: within the box of a slanting crack others may lie."""


def whole_objects(boxes: Float32Array, classes: Int64Array, masks: Float32Array | None) -> IndexArray:
    """The rows of one look's detections that are not parts of a more confident one of the same class.

    Args:
        boxes: (n, 4) left, top, right, bottom in pixels, the most confident first.
        classes: (n,) of the five.
        masks: (n, cells, cells) of defects within their boxes, 0 … 1; without them single cracks are all kept.
    """
    is_part = (_shares(boxes.astype(float)) >= WITHIN) & (classes[:, None] == classes)
    for part, whole in np.argwhere(np.tril(is_part, -1) & (classes == SINGLE_CRACK)).tolist():
        is_part[part, whole] = masks is not None and _covered(boxes, masks, part, whole) >= COVERED
    is_kept = np.zeros(len(boxes), dtype=bool)
    for row in range(len(boxes)):
        is_kept[row] = not (is_part[row, :row] & is_kept[:row]).any()
    return np.flatnonzero(is_kept)


def _shares(boxes: Float64Array) -> Float64Array:
    """(n, n) how much of each box lies within each."""
    shares: Float64Array = shared_areas(boxes, boxes) / np.maximum(areas(boxes), 1e-9)[:, None]
    return shares


def _covered(boxes: Float32Array, masks: Float32Array, part: int, whole: int) -> float:
    """Share of the cells of a part's mask whose middles the mask of the whole covers; 0 of an empty mask."""
    rows, columns = np.nonzero(masks[part] >= IS_COVERED)
    if not len(rows):
        return 0.0
    cells = np.array(masks.shape[:0:-1], dtype=float)
    corner, sides = boxes[part, :2], boxes[part, 2:] - boxes[part, :2]
    middles = corner + (np.stack([columns, rows], axis=1) + 0.5) * sides / cells
    places = np.floor((middles - boxes[whole, :2]) * cells / (boxes[whole, 2:] - boxes[whole, :2])).astype(int)
    inside = ((places >= 0) & (places < cells)).all(axis=1)
    at = places[inside]
    hit: BoolArray = masks[whole][at[:, 1], at[:, 0]] >= IS_COVERED
    return float(hit.sum() / len(rows))
