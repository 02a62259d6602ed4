"""Areas of many boxes (left, top, right, bottom), and what each shares with each of others."""

import numpy as np

from pavetwin.arrays import Float64Array


def areas(boxes: Float64Array) -> Float64Array:
    """(n,) of boxes (n, 4); 0 where one is turned inside out, as where nothing was shared."""
    sides = np.maximum(boxes[:, 2:] - boxes[:, :2], 0.0)
    product: Float64Array = sides[:, 0] * sides[:, 1]
    return product


def shared_areas(boxes: Float64Array, others: Float64Array) -> Float64Array:
    """(n, m) of boxes (n, 4) with others (m, 4)."""
    low = np.maximum(boxes[:, None, :2], others[:, :2])
    high = np.minimum(boxes[:, None, 2:], others[:, 2:])
    product: Float64Array = np.maximum(high - low, 0.0).prod(axis=2)
    return product
