"""Boxes that overlap a more confident one of their class: the more they do, the less their confidence says.

Non-maximum suppression drops a box only where it is nearly the same as a more confident one. Of what it keeps, many
show an object that was found already, with a box that fits less well; others are objects of their own that stand close.
"""

from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, Float64Array, Int64Array
from pavetwin.perception.box_pairs import areas, shared_areas

SIGMA: Final = 0.5
"""Of e^(−u² / σ), by which a confidence is multiplied at an IoU of u: as Soft-NMS was published."""


def lowering(boxes: Float32Array, classes: Int64Array) -> Float64Array:
    """(n,) what the confidences of one look's detections are multiplied by, 0 … 1 (Matrix NMS, Wang et al. 2020).

    It is the least of f(u) / f(v) over the more confident boxes of the same class, at most 1, with f(u) = e^(−u² / σ),
    u their IoU with the box and v their own greatest IoU with a box more confident than they are: what is lowered
    itself lowers others less.

    Args:
        boxes: (n, 4) left, top, right, bottom in pixels, the most confident first.
        classes: (n,) of the five.
    """
    others = np.triu(_overlaps(boxes.astype(float)) * (classes[:, None] == classes), 1)  # of the surer ones: rows
    own = others.max(axis=0, initial=0.0)
    factors: Float64Array = np.exp((own[:, None] ** 2 - others**2) / SIGMA).min(axis=0, where=others > 0, initial=1.0)
    return factors


def _overlaps(boxes: Float64Array) -> Float64Array:
    """(n, n) IoU of each box with each."""
    both, own = shared_areas(boxes, boxes), areas(boxes)
    iou: Float64Array = both / np.maximum(own[:, None] + own - both, 1e-9)
    return iou
