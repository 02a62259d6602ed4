"""Which level of detail of `scene.coarser` a mesh has in a picture, and in its shadows."""

from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, Int64Array
from pavetwin.render.meshes import FaceCulling
from pavetwin.scene.coarser import FINEST_M, coarser, thinned
from pavetwin.scene.model import Mesh

LEVELS: Final = 5
"""Number of coarser levels."""

_CLOSED_SHARE: Final = 0.98
_CELL_PX: Final = 0.75


def culling_of(mesh: Mesh) -> FaceCulling:
    """Which faces of a model's triangles are drawn."""
    if mesh.uv is not None:
        return FaceCulling.ALPHA_CUTOUT
    return FaceCulling.BACK_CULLED if is_closed(mesh) else FaceCulling.DOUBLE_SIDED


def is_closed(mesh: Mesh) -> bool:
    """Whether a mesh is closed: nearly every edge is shared by a second triangle of opposite direction."""
    _, place = np.unique(np.round(mesh.positions / 1e-4).astype(np.int64), axis=0, return_inverse=True)
    corners = place.reshape(-1)[mesh.indices]
    starts, ends = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    size = int(place.max(initial=0)) + 1
    ways, there = starts.astype(np.int64) * size + ends, ends.astype(np.int64) * size + starts
    return bool(np.isin(ways, there).mean() > _CLOSED_SHARE) if len(ways) else False


def level_of(least_px2: Float64Array, area_m2: Float64Array, pixel_m: Float64Array) -> Int64Array:
    """The coarsest level without a visible difference, 0 … LEVELS.

    Args:
        least_px2: (n,) `foliage_px2` of each mesh.
        area_m2: (n,) of its mean triangle.
        pixel_m: (n,) side of a pixel where it stands.
    """
    solid = np.floor(np.log2(np.maximum(_CELL_PX * pixel_m / FINEST_M, 0.5))) + 1
    thin = np.floor(np.log2(np.maximum(least_px2 * pixel_m**2 / np.maximum(area_m2, 1e-9), 1.0)))
    return np.clip(np.where(least_px2 > 0, thin, solid), 0, LEVELS).astype(np.int64)


def casting(mesh: Mesh, level: int) -> Mesh:
    """The shadow caster of a mesh at a level: of leaf cards every other one.

    All of them let half a percent of the sun through a crown's middle; measured crowns in leaf let 1.3 to 5.3 % through
    (Konarska et al. 2014, Theoretical and Applied Climatology 117). The cost of a shadow map is the area of its cards.
    """
    return thinned(mesh, level, sparser=2) if mesh.uv is not None else coarser(mesh, level)
