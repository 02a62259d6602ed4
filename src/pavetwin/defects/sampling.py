"""Points spread evenly over a defect, to estimate the hidden share of its area."""

import numpy as np
import shapely

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.world.model import Defect

COARSENED_M = 0.005
"""Tolerance of the simplified outline: sampling takes a tenth of the time, with the same hidden share."""

ABOUT = 128
"""With this many points a straight occlusion edge across a defect hides a share of points within 0.035 of the share of
its area, in 99 of 100 cases; with 48 points it is 0.08."""


def sample_points(defect: Defect, about: int = ABOUT) -> Float64Array:
    """(about, 2) points in the defect's polygon (world frame, metres; to within 5 mm), each for the same area.

    The polygon is triangulated, and the points are distributed over the triangles by area, in spatial order, so that a
    crack two millimetres wide gets as many as a pothole. No randomness: the same polygon gives the same points.

    Raises:
        ValueError: `about` is below 1.
    """
    if about < 1:
        raise ValueError(f"a defect cannot be sampled with {about} points")
    coarse = shapely.simplify(defect.polygon, COARSENED_M)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(coarse))
    middles = shapely.get_coordinates(shapely.centroid(triangles))
    triangles = triangles[np.argsort(_place_on_curve(middles), kind="stable")]
    areas = shapely.area(triangles)
    ends = np.cumsum(areas)
    at = (np.arange(about) + 0.5) / about * ends[-1]
    index = np.minimum(np.searchsorted(ends, at), len(triangles) - 1)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[index, :3]
    share = np.clip((at - (ends[index] - areas[index])) / np.maximum(areas[index], 1e-30), 0.0, 1.0)
    root, second = np.sqrt(share), _van_der_corput(about)
    weights = np.stack([1 - root, root * (1 - second), root * second], axis=1)
    return np.asarray(np.einsum("kc,kcd->kd", weights, corners), dtype=np.float64)


def _place_on_curve(xy: Float64Array) -> Int64Array:
    """(n,) positions of points (n, 2) along a Z-order curve (Morton), which keeps neighbours together."""
    low = xy.min(axis=0)
    cells = ((xy - low) / max(float(np.ptp(xy, axis=0).max()), 1e-9) * 1023).astype(np.int64)
    bits = [((cells[:, axis] >> bit) & 1) << (2 * bit + axis) for bit in range(10) for axis in (0, 1)]
    return np.asarray(np.sum(bits, axis=0), dtype=np.int64)


def _van_der_corput(count: int) -> Float64Array:
    """(count,) evenly spread numbers in (0, 1): the van der Corput sequence in base 2."""
    values = np.zeros(count)
    number, scale = np.arange(1, count + 1), 0.5
    while number.any():
        values += scale * (number & 1)
        number, scale = number >> 1, scale / 2
    return values
