"""A heightfield as a triangle mesh: dense where the surface is curved, its border exactly at the road's height."""

from dataclasses import dataclass

import numpy as np

from pavetwin._core import relief_mesh
from pavetwin.arrays import Float32Array, UInt32Array
from pavetwin.defects.heightfield import Heightfield

TOLERANCE_M = 0.002
MOST_VERTICES = 20_000


@dataclass(frozen=True, eq=False)
class DefectMesh:
    """Triangles over a defect's outline, anticlockwise from above, in the defect's own frame."""

    positions: Float32Array
    """(n, 3) metres. The first `border` of them are the outline's corners in its order, at z = 0."""
    uv: Float32Array
    """(n, 2) into the heightfield's maps; see `Heightfield.uv`."""
    indices: UInt32Array
    """(m, 3)."""
    border: int


def mesh_of(
    heightfield: Heightfield, tolerance_m: float = TOLERANCE_M, most_vertices: int = MOST_VERTICES
) -> DefectMesh:
    """A mesh that is within `tolerance_m` of the heightfield everywhere, or has `most_vertices`.

    Its border is the defect's outline, so it fits a hole that is cut into the road along that polygon.

    Raises:
        ValueError: the tolerance is not positive.
    """
    if tolerance_m <= 0:
        raise ValueError(f"a tolerance of {tolerance_m:g} m is not positive")
    ring = np.ascontiguousarray(np.asarray(heightfield.outline.exterior.coords)[:-1])
    made = relief_mesh(heightfield.lattice, heightfield.height_m, ring, tolerance_m, most_vertices)
    if made is None:
        raise ValueError("the outline crosses itself")
    positions, indices, _ = made
    uv = heightfield.uv(positions[:, :2].astype(np.float64))
    return DefectMesh(positions, uv, indices, len(ring))
