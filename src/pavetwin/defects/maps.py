"""A heightfield as textures: normals, albedo, ambient occlusion. Row 0 holds the smallest y, as in `Heightfield.uv`."""

import numpy as np

from pavetwin._core import relief_widths
from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from pavetwin.defects.heightfield import Heightfield
from pavetwin.defects.shapes import smooth


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


CRACK = (0.22, 0.21, 0.20)
"""Share of the defect-free road's albedo: little light comes back out of an open crack."""
CRACK_FLOOR, SEEN_M = (0.48, 0.45, 0.40), (0.015, 0.05)
"""Widths over which a crack's fill becomes visible: a wide crack is drawn in its depth, darkened by its own shadow."""
DIRT = (0.50, 0.48, 0.44)
BROKEN = (1.22, 1.18, 1.11)
"""Albedo factor of aggregate without its film of bitumen: lighter and warmer than the road."""
DUST = (1.42, 1.38, 1.28)
STONE = (1.45, 1.40, 1.32)
STONE_CONTRAST = 0.3
"""Spread of the brightness of single stones around their mean."""

BROKEN_SHARE = (0.0, 0.2)
"""Exposed shares between which a cell of a hole becomes wholly broken; blocks that sank as a whole have none."""
LOST_M = (0.005, 0.015)
"""Depths between which nothing of a broken surface is left: stones of its course are 5 to 15 mm. Ours."""

CAVITY_SCALES_M = (0.02, 0.08, 0.25)
CAVITY_STRENGTH = 1.1


def normal_map(heightfield: Heightfield) -> UInt8Array:
    """(rows, cols, 3) tangent-space normals: red along x, green along y, blue up, 0 … 255 for -1 … 1."""
    slope_y, slope_x = np.gradient(heightfield.height_m, np.float32(heightfield.cell_m))
    inverse = 1 / np.sqrt(slope_x * slope_x + slope_y * slope_y + 1)
    normals = np.stack([-slope_x * inverse, -slope_y * inverse, inverse], axis=-1)
    return np.asarray(np.round(normals * 127.5 + 127.5), dtype=np.uint8)


def albedo_factor(heightfield: Heightfield) -> Float32Array:
    """(rows, cols, 3) factor of the road's albedo (linear red, green, blue); 1 where there is no defect."""
    stains = heightfield.stains
    contrast = 1 + STONE_CONTRAST * stains.tone[..., None]
    factor = np.ones((*heightfield.shape, 3), dtype=np.float32)
    factor = _mixed(factor, contrast * np.array(BROKEN, dtype=np.float32), heightfield.exposed)
    factor = _mixed(factor, np.array(DUST, dtype=np.float32), stains.dust)
    factor = _mixed(factor, np.array(DIRT, dtype=np.float32), stains.dirt)
    factor = _mixed(factor, _within(heightfield), heightfield.opening)
    return _mixed(factor, contrast * np.array(STONE, dtype=np.float32), stains.stone)


def lost_surface(heightfield: Heightfield) -> Float32Array:
    """(rows, cols) share of the road's surface that is gone, with the paint and sealant on it: open, bare, or below it
    where it is broken. Blocks that sank whole keep theirs."""
    broken = smooth(heightfield.exposed, *BROKEN_SHARE) * smooth(-heightfield.height_m, *LOST_M)
    left = (1 - heightfield.opening) * (1 - np.maximum(heightfield.exposed, broken))
    return np.asarray(1 - left, dtype=np.float32)


def occlusion_map(heightfield: Heightfield) -> UInt8Array:
    """(rows, cols) ambient occlusion: share of the sky's light that reaches a cell, 255 for all of it.

    At each of three scales r, the mean height around a cell less its own, over r, approximates the tangent of the
    horizon; the light falls with its exponential.
    """
    darkness = np.zeros(heightfield.shape, dtype=np.float32)
    for scale in CAVITY_SCALES_M:
        size = 2 * round(scale / heightfield.cell_m) + 1
        around = mean_around(heightfield.height_m, size, repeats_edge=True)
        darkness += np.maximum(around - heightfield.height_m, 0) / np.float32(scale)
    return np.asarray(np.round(255 * np.exp(-CAVITY_STRENGTH * darkness)), dtype=np.uint8)


def _within(heightfield: Heightfield) -> Float32Array:
    """(rows, cols, 3) the factor in openings."""
    dark, floor = np.array(CRACK, dtype=np.float32), np.array(CRACK_FLOOR, dtype=np.float32)
    width = relief_widths(heightfield.opening) * np.float32(heightfield.cell_m)
    return dark + (floor - dark) * smooth(width, *SEEN_M)[..., None]


def _mixed(below: Float32Array, above: Float32Array, share: Float32Array) -> Float32Array:
    return np.asarray(below + (above - below) * share[..., None], dtype=np.float32)
