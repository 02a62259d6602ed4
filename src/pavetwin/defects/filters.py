"""Means and distances on fields of cells, by OpenCV: SciPy's take a quarter of a second to import."""

import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, Float64Array


def mean_around(field: Float32Array, size: int, *, repeats_edge: bool = False) -> Float32Array:
    """(rows, cols) mean over the square of `size` × `size` cells around each.

    Args:
        repeats_edge: beyond the field its outermost cells repeat; else it is mirrored there.
    """
    import cv2  # 30 MB that missions need not hold

    border = cv2.BORDER_REPLICATE if repeats_edge else cv2.BORDER_REFLECT
    found, half = field, size // 2
    for shape, middle in (((1, size), (0, half)), ((size, 1), (half, 0))):
        found = cv2.blur(found.astype(np.float64), shape, anchor=middle, borderType=border).astype(np.float32)
    return found


def distances_px(inside: BoolArray) -> Float64Array:
    """(rows, cols) distance of each cell from the nearest that is not inside [cells], up to 4000."""
    import cv2  # as above

    near = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Squares of distances are whole numbers; OpenCV gives their roots in single precision.
    return np.asarray(np.sqrt(np.rint(np.square(near.astype(np.float64)))), dtype=np.float64)
