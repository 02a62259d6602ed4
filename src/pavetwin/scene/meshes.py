"""Meshes of a scene: bounds, joining, triangles of flat shapes, normals."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from pavetwin.arrays import Float32Array, Float64Array, GeometryArray, UInt32Array
from pavetwin.scene.values import FacadePiece, GroundPiece, Mesh


def bounds(mesh: Mesh) -> tuple[Float64Array, Float64Array]:
    """Lowest and highest corner (3,) of a mesh."""
    return mesh.positions.min(axis=0).astype(np.float64), mesh.positions.max(axis=0).astype(np.float64)


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes with the same attributes as one."""
    starts = np.cumsum([0, *(len(mesh.positions) for mesh in meshes[:-1])])

    def joined(name: str) -> Any:
        arrays = [getattr(mesh, name) for mesh in meshes]
        return None if any(array is None for array in arrays) else np.concatenate(arrays)

    indices = np.concatenate([mesh.indices + np.uint32(start) for mesh, start in zip(meshes, starts, strict=True)])
    names = ("positions", "normals", "colours", "surface", "uv")
    return Mesh(indices=indices, **{name: joined(name) for name in names})


def merged_pieces(pieces: Sequence[GroundPiece | FacadePiece]) -> Mesh | None:
    """The meshes of some pieces as one; None if there is no triangle."""
    return merged([piece.mesh for piece in pieces]) if any(len(piece.mesh.indices) for piece in pieces) else None


def corners_of(triangles: shapely.Geometry | GeometryArray) -> Float64Array:
    """(n, 3, 2) corners of all triangles in a collection, or in an array of them."""
    return shapely.get_coordinates(shapely.get_parts(triangles)).reshape(-1, 4, 2)[:, :3]


def anticlockwise(corners: Float64Array) -> Float64Array:
    """Corners (n, 3, 2) of triangles with clockwise ones reversed, in place."""
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    clockwise = ax * by - ay * bx < 0
    corners[clockwise] = corners[clockwise][:, ::-1]
    return corners


def upward_normals(count: int) -> Float32Array:
    """(count, 3) normals of level ground."""
    return np.tile(np.array([0, 0, 1], dtype=np.float32), (count, 1))


def normals_of(positions: Float64Array, triangles: npt.NDArray[np.integer] | UInt32Array) -> Float32Array:
    """Normals weighted by area: large faces stay flat, a bevel between them turns from one to the other."""
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    summed = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(summed, triangles[:, corner], normal)
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return np.where(length > 1e-12, summed / np.maximum(length, 1e-12), (0.0, 0.0, 1.0)).astype(np.float32)
