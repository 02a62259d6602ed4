"""Points spread evenly over a defect, to tell which share of its area is hidden."""

import numpy as np
import numpy.typing as npt
import shapely

from pavetwin.world.model import Defect


def sample_points(defect: Defect, about: int = 48) -> npt.NDArray[np.float64]:
    """(about, 2) points in the defect's polygon (world frame, metres), each standing for the same area.

    The polygon is triangulated, and the points are dealt to the triangles by area, so that a crack two millimetres wide
    gets as many as a pothole. No randomness: the same polygon gives the same points.

    Raises:
        ValueError: `about` is below 1.
    """
    if about < 1:
        raise ValueError(f"a defect cannot be sampled with {about} points")
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(defect.polygon))
    areas = shapely.area(triangles)
    ends = np.cumsum(areas)
    at = (np.arange(about) + 0.5) / about * ends[-1]
    index = np.minimum(np.searchsorted(ends, at), len(triangles) - 1)
    corners = np.array([triangles[each].exterior.coords[:3] for each in index], dtype=np.float64)[:, :, :2]
    share = np.clip((at - (ends[index] - areas[index])) / np.maximum(areas[index], 1e-30), 0.0, 1.0)
    root, second = np.sqrt(share), _van_der_corput(about)
    weights = np.stack([1 - root, root * (1 - second), root * second], axis=1)
    return np.asarray(np.einsum("kc,kcd->kd", weights, corners), dtype=np.float64)


def _van_der_corput(count: int) -> npt.NDArray[np.float64]:
    """(count,) evenly spread numbers in (0, 1): the bits of 1 … count read backwards."""
    values = np.zeros(count)
    number, scale = np.arange(1, count + 1), 0.5
    while number.any():
        values += scale * (number & 1)
        number, scale = number >> 1, scale / 2
    return values
