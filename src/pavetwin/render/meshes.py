"""Meshes on the device: positions in a buffer of their own, as shadow and amodal passes read nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

import numpy as np
import wgpu

from pavetwin.arrays import (
    AnyArray,
    Float32Array,
    Float64Array,
    Int64Array,
    StructuredArray,
    UInt8Array,
    UInt32Array,
)
from pavetwin.render.gpu import Gpu
from pavetwin.scene.coarser import triangle_areas_m2
from pavetwin.scene.meshes import merged_pieces
from pavetwin.scene.values import DefectPatch, FacadePiece, Finish, GroundKind, GroundPiece, Mesh

_VERTEX: Final = wgpu.BufferUsage.VERTEX
_INDEX: Final = wgpu.BufferUsage.INDEX

_GROUND: Final = np.dtype([("normal", "u1", 4), ("uv", "f4", 2), ("finish", "u1", 4)])
_MODEL: Final = np.dtype([("normal", "u1", 4), ("colour", "f2", 4), ("surface", "u1", 4)])
_TEXTURED: Final = np.dtype([*_MODEL.descr, ("uv", "f4", 2)])
_PATCH: Final = np.dtype([("normal", "u1", 4), ("uv", "f4", 2), ("along", "f4", 2), ("finish", "u1", 4)])

POSITIONS: Final = {
    "array_stride": 12,
    "step_mode": "vertex",
    "attributes": [{"format": "float32x3", "offset": 0, "shader_location": 10}],
}
"""Layout of the positions' buffer."""


def _layout(dtype: np.dtype[Any], formats: tuple[str, ...]) -> dict[str, Any]:
    assert dtype.names is not None
    assert dtype.fields is not None
    attributes = [
        {"format": format, "offset": dtype.fields[name][1], "shader_location": 11 + index}
        for index, (name, format) in enumerate(zip(dtype.names, formats, strict=True))
    ]
    return {"array_stride": dtype.itemsize, "step_mode": "vertex", "attributes": attributes}


LAYOUTS: Final = {
    "ground": _layout(_GROUND, ("uint8x4", "float32x2", "uint8x4")),
    "model": _layout(_MODEL, ("uint8x4", "float16x4", "uint8x4")),
    "leaf": _layout(_TEXTURED, ("uint8x4", "float16x4", "uint8x4", "float32x2")),
    "facade": _layout(_TEXTURED, ("uint8x4", "float16x4", "uint8x4", "float32x2")),
    "patch": _layout(_PATCH, ("uint8x4", "float32x2", "float32x2", "uint8x4")),
}
"""Layouts of the buffers of the other attributes, by material."""


class FaceCulling(IntEnum):
    """Which faces of a mesh's triangles are drawn; pipelines of models are in this order."""

    DOUBLE_SIDED = 0
    """Both faces."""
    BACK_CULLED = 1
    """Front faces only."""
    ALPHA_CUTOUT = 2
    """Both faces, cut out by the alpha of the leaf atlas."""


@dataclass(frozen=True)
class GpuMesh:
    """One mesh on the device."""

    positions: Any
    attributes: Any
    indices: Any
    count: int
    """Number of indices."""
    low: Float64Array
    high: Float64Array
    """(3,) corners of its box, in its own frame."""
    culling: FaceCulling = FaceCulling.DOUBLE_SIDED

    @property
    def buffers(self) -> tuple[Any, Any, Any]:
        return self.positions, self.attributes, self.indices

    def draw(self, render_pass: Any, instances: int, first: int, *, attributes: bool) -> None:
        """Draw it for `instances` records of the instance buffer from `first` on; leaf cards always need attributes."""
        if not self.count:
            return
        render_pass.set_vertex_buffer(1, self.positions)
        if attributes or self.culling is FaceCulling.ALPHA_CUTOUT:
            render_pass.set_vertex_buffer(2, self.attributes)
        render_pass.set_index_buffer(self.indices, "uint32")
        render_pass.draw_indexed(self.count, instances, 0, 0, first)


def upload_model(gpu: Gpu, mesh: Mesh, culling: FaceCulling) -> GpuMesh:
    """A part of a model; leaf cards have uv."""
    rows = _model_rows(mesh, _TEXTURED if culling is FaceCulling.ALPHA_CUTOUT else _MODEL)
    if culling is FaceCulling.ALPHA_CUTOUT:
        rows["uv"] = mesh.uv
    return replace(_upload(gpu, mesh.positions, rows, mesh.indices), culling=culling)


def split_by_area(gpu: Gpu, whole: GpuMesh, mesh: Mesh, area_m2: float) -> tuple[GpuMesh, GpuMesh]:
    """The triangles of an uploaded mesh that are larger than an area, and the others; they share its vertices."""
    large = triangle_areas_m2(mesh) > area_m2
    chosen = [mesh.indices[which].reshape(-1) for which in (large, ~large)]
    # A buffer holds at least one triangle; it is not drawn.
    buffers = [gpu.buffer(each if len(each) else mesh.indices[:1].reshape(-1), _INDEX) for each in chosen]
    first, second = (replace(whole, indices=made, count=each.size) for made, each in zip(buffers, chosen, strict=True))
    return first, second


def upload_ground(gpu: Gpu, pieces: tuple[GroundPiece, ...]) -> GpuMesh | None:
    """All ground of one tile as one mesh, the kind of each vertex next to its normal."""
    mesh = merged_pieces(pieces)
    if mesh is None:
        return None
    rows = np.zeros(len(mesh.positions), dtype=_GROUND)
    rows["normal"][:, :3], rows["normal"][:, 3] = _packed(mesh.normals), _each_vertex(pieces, "kind")
    rows["uv"] = mesh.positions[:, :2] if mesh.uv is None else mesh.uv
    counts = [len(piece.mesh.positions) for piece in pieces]
    rows["finish"] = np.repeat([_finish(piece.finish) for piece in pieces], counts, axis=0)
    return _upload(gpu, mesh.positions, rows, mesh.indices)


def upload_kerbs(gpu: Gpu, pieces: tuple[GroundPiece, ...]) -> GpuMesh | None:
    """The parts of a tile's ground that cast shadows, such as kerbs."""
    mesh = merged_pieces([piece for piece in pieces if piece.kind is GroundKind.KERB])
    return None if mesh is None else _upload(gpu, mesh.positions, np.zeros(1, dtype=_GROUND), mesh.indices)


def upload_facades(gpu: Gpu, pieces: tuple[FacadePiece, ...]) -> GpuMesh | None:
    """All buildings of one tile as one mesh."""
    mesh = merged_pieces(pieces)
    if mesh is None:
        return None
    rows = _model_rows(mesh, _TEXTURED)
    rows["surface"][:, 3] = _each_vertex(pieces, "layer") + 1
    if mesh.uv is not None:
        rows["uv"] = mesh.uv
    return _upload(gpu, mesh.positions, rows, mesh.indices)


def upload_patch(gpu: Gpu, patch: DefectPatch, mesh: Mesh, origin: tuple[float, float]) -> GpuMesh:
    """The pavement around a defect, moved into the frame of the tile whose corner is `origin`."""
    moved = mesh.positions @ patch.transform[:3, :3].T + patch.transform[:3, 3] - (*origin, 0.0)
    along = patch.transform[:2, 0] / np.linalg.norm(patch.transform[:2, 0])
    rows = np.zeros(len(moved), dtype=_PATCH)
    rows["normal"][:, :3] = _packed(mesh.normals @ patch.transform[:3, :3].T)
    rows["along"] = along
    rows["normal"][:, 3], rows["finish"] = int(patch.kind), _finish(patch.finish)
    if mesh.uv is not None:
        rows["uv"] = mesh.uv
    return _upload(gpu, moved.astype(np.float32), rows, mesh.indices)


def _each_vertex(pieces: Sequence[GroundPiece | FacadePiece], what: str) -> Int64Array:
    """A number of each piece, for each of its vertices."""
    return np.repeat([int(getattr(piece, what)) for piece in pieces], [len(piece.mesh.positions) for piece in pieces])


def _model_rows(mesh: Mesh, dtype: np.dtype[Any]) -> StructuredArray:
    """Normals, colours and surface; a mesh without a surface is rough and plain."""
    rows = np.zeros(len(mesh.positions), dtype=dtype)
    rows["normal"][:, :3] = _packed(mesh.normals)
    rows["colour"][:, :3], rows["colour"][:, 3] = 0.5 if mesh.colours is None else mesh.colours, 1
    rows["surface"][:, :3] = (230, 0, 0) if mesh.surface is None else mesh.surface
    return rows


def _upload(gpu: Gpu, positions: Float32Array, rows: AnyArray, indices: UInt32Array) -> GpuMesh:
    return GpuMesh(
        gpu.buffer(positions.astype(np.float32), _VERTEX),
        gpu.buffer(rows.view(np.uint8), _VERTEX),
        gpu.buffer(indices.reshape(-1), _INDEX),
        indices.size,
        positions.min(axis=0).astype(np.float64),
        positions.max(axis=0).astype(np.float64),
    )


def _finish(finish: Finish) -> UInt8Array:
    """128 for 1."""
    return np.asarray(np.rint(np.array(finish) * 128), dtype=np.uint8)


def _packed(normals: AnyArray) -> UInt8Array:
    return np.asarray(np.rint(normals * 127) + 128, dtype=np.uint8)
