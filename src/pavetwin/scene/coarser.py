"""Levels of detail: coarser meshes for distant objects, as a triangle smaller than a pixel costs as much as a large
one.

Solid meshes are simplified by vertex clustering (Rossignac and Borrel 1993). Foliage, made of separate triangles or
cards, is thinned, and the rest enlarged, so that the covered area stays the same.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float32Array, Float64Array, UInt32Array
from pavetwin.scene.values import Mesh

FINEST_M: Final = 0.015
"""Cell of the first coarser level of solid meshes [m]; it doubles from level to level."""

_LEAF_PX2: Final = 4.0
_CARD_PX2: Final = 32.0


def triangle_areas_m2(mesh: Mesh) -> Float64Array:
    """(n,) of a mesh's triangles."""
    a, b, c = (mesh.positions[mesh.indices[:, corner]].astype(np.float64) for corner in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def foliage_px2(mesh: Mesh) -> float:
    """Least pixels that a triangle of foliage should cover: of leaf cards, or of triangles that share almost no
    vertices. 0 for solid meshes."""
    if mesh.uv is not None:
        return _CARD_PX2
    return _LEAF_PX2 if len(mesh.positions) > 2.2 * len(mesh.indices) else 0.0


def mean_area_m2(mesh: Mesh) -> float:
    """Area of a triangle."""
    return float(triangle_areas_m2(mesh).mean()) if len(mesh.indices) else 0.0


def coarser(mesh: Mesh, level: int) -> Mesh:
    """A mesh at a level of detail; 0 is the original."""
    if level == 0 or len(mesh.indices) == 0:
        return mesh
    return thinned(mesh, level) if foliage_px2(mesh) else _clustered(mesh, FINEST_M * 2 ** (level - 1))


def thinned(mesh: Mesh, level: int, sparser: int = 1) -> Mesh:
    """Keep one in 2^level cards or triangles, enlarged to match; of those, keep one in `sparser` without enlarging."""
    together = 1 if mesh.uv is None else 2
    kept = mesh.indices.reshape(-1, 3 * together)[:: sparser * 2**level]
    corners = mesh.positions[kept]
    middle = corners.mean(axis=1, keepdims=True)
    grown = (middle + (corners - middle) * np.float32(2 ** (level / 2))).reshape(-1, 3)
    return _with(mesh, kept.reshape(-1), grown, np.arange(kept.size, dtype=np.uint32).reshape(-1, 3))


def closed(mesh: Mesh, cell_m: float) -> Mesh:
    """A solid mesh with all vertices of a cell at the place of the outermost: it keeps its size, and surfaces that met
    still meet. Those that face elsewhere or have another slot keep their own normals and colours. Triangles within
    fewer than three cells are dropped, so that parts thinner than a cell may vanish, and of several with the same
    corners the others.

    Args:
        cell_m: side of a cell.
    """
    _, place = np.unique(np.floor(mesh.positions / cell_m).astype(np.int64), axis=0, return_inverse=True)
    place = place.reshape(-1)
    corners = np.sort(place[mesh.indices], axis=1)
    whole = np.flatnonzero((corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]))
    kept = whole[np.sort(np.unique(corners[whole], axis=0, return_index=True)[1])]
    group = _groups(mesh, place[:, None])
    first = np.unique(group, return_index=True)[1]
    used, triangles = np.unique(group[mesh.indices[kept]], return_inverse=True)
    vertices = first[used]
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    inwards = -np.linalg.norm((2 * mesh.positions - low - high) / np.maximum(high - low, cell_m), axis=1)
    positions = mesh.positions[_least(inwards, place)[place[vertices]]]
    return _with(mesh, vertices, positions, triangles.reshape(-1, 3).astype(np.uint32))


def _clustered(mesh: Mesh, cell_m: float) -> Mesh:
    """Merge vertices of one cell, one slot and similar normals into the one nearest to their mean."""
    cells = np.floor(mesh.positions / cell_m).astype(np.int64)
    group = _groups(mesh, cells)
    count = np.bincount(group).astype(np.float64)
    middle = np.stack([np.bincount(group, mesh.positions[:, axis]) for axis in range(3)], axis=1) / count[:, None]
    chosen = _least(np.linalg.norm(mesh.positions - middle[group], axis=1), group)
    triangles = group[mesh.indices]
    # A triangle whose corners fall into fewer than three cells is dropped, whatever their normals.
    place = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)[mesh.indices]
    whole = (place[:, 0] != place[:, 1]) & (place[:, 1] != place[:, 2]) & (place[:, 2] != place[:, 0])
    triangles = np.unique(triangles[whole], axis=0) if whole.any() else triangles[:1]
    return _with(mesh, chosen, mesh.positions[chosen], triangles.astype(np.uint32))


def _groups(mesh: Mesh, cells: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """(n,) the group of each vertex: those of one cell, one slot and similar normals."""
    facing = (mesh.normals > 0.5).astype(np.int64) - (mesh.normals < -0.5)
    slot = np.zeros((len(cells), 1), dtype=np.int64) if mesh.surface is None else mesh.surface[:, 2:].astype(np.int64)
    return np.unique(np.concatenate([cells, facing, slot], axis=1), axis=0, return_inverse=True)[1].reshape(-1)


def _least(values: Float64Array, group: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """(groups,) the vertex of each group whose value is the least."""
    order = np.lexsort((values, group))
    return np.asarray(order[np.searchsorted(group[order], np.arange(group.max() + 1))])


def _with(mesh: Mesh, vertices: npt.NDArray[np.integer], positions: Float32Array, indices: UInt32Array) -> Mesh:
    """Some vertices of a mesh at new positions."""
    others: dict[str, Any] = {name: getattr(mesh, name) for name in ("normals", "colours", "surface", "uv")}
    kept = {name: values[vertices] for name, values in others.items() if values is not None}
    return replace(mesh, positions=positions.astype(np.float32), indices=indices, **kept)
