"""The passes of one frame, recorded and read back: shadow map, then the image with its ground truth."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import wgpu

from pavetwin.arrays import AnyArray, Float16Array, Float32Array, Int64Array, UInt32Array
from pavetwin.render.gpu import Gpu
from pavetwin.render.meshes import GpuMesh
from pavetwin.render.pipelines import DEPTH_FORMAT, DISTANCE_FORMAT, LABEL_FORMAT, LIGHT_FORMAT, Pipelines
from pavetwin.render.tile_cache import GpuPatch, GpuPavement, GpuTile

_READ: Final = wgpu.TextureUsage.COPY_SRC
_NOWHERE: Final = (np.inf, 0.0, 0.0, 0.0)


MeshDraw = tuple[GpuMesh, int, int]
"""Mesh, count, first record."""


@dataclass(frozen=True)
class PatchDraw:
    """A defect's pavement patch in the frame of its tile."""

    patch: GpuPatch
    mesh: GpuMesh
    """The fine or the coarse mesh of the patch."""
    around: GpuPavement
    origin: tuple[float, float]
    """The tile's, metres."""
    record: int
    """Its record in the instance buffer."""


@dataclass(frozen=True)
class DrawList:
    """Draw list of one frame. Numbers are indices of records in the instance buffer."""

    tiles: list[tuple[GpuTile, int]]
    """Each with its record."""
    grounds: list[tuple[GpuTile, GpuPavement, int]]
    """Tiles whose ground is in view."""
    patches: list[PatchDraw]
    near: list[MeshDraw]
    """Triangles of models that are lit at every pixel."""
    far: list[MeshDraw]
    """The others: small ones, lit at their vertices."""
    casters: list[MeshDraw]
    """Shadow casters."""
    shades: tuple[int, int]
    """Contact shadows: count, first record."""
    strips: tuple[int, int]
    """Strips of ground that wires and twigs shade: count, first record."""
    levels: Int64Array
    """Level of detail of each agent; −1 if it is not drawn."""
    sky: bool
    """Whether the image reaches beyond the ground that is drawn."""
    looks_down: bool
    """See `nearby.looks_down`."""


@dataclass(frozen=True)
class Materials:
    """Bind groups of the textures shared by the whole scene."""

    ground: Any
    facades: Any
    leaves: Any


class RenderTargets:
    """The render targets of one image size, and a buffer to read them through."""

    def __init__(self, gpu: Gpu, size_px: tuple[int, int]) -> None:
        self.size_px = size_px
        self.light = gpu.target(size_px, LIGHT_FORMAT, usage=_READ)
        self.labels = gpu.target(size_px, LABEL_FORMAT, usage=_READ)
        self.distances = gpu.target(size_px, DISTANCE_FORMAT, usage=_READ)
        self.depth = gpu.target(size_px, DEPTH_FORMAT)
        self._light_row, self._truth_row = (_padded(size_px[0] * texel) for texel in (8, 4))
        self._staging = gpu.empty_buffer(
            size_px[1] * (self._light_row + 2 * self._truth_row), wgpu.BufferUsage.MAP_READ
        )

    @property
    def resources(self) -> tuple[Any, ...]:
        """All textures and buffers, to be freed."""
        return self.light, self.labels, self.distances, self.depth, self._staging

    def copy(self, encoder: Any, *, truth: bool) -> None:
        """Record the copies that `read` reads; `truth`: distances and labels too."""
        (width, height), offset = self.size_px, 0
        for texture, row in self._copied(truth):
            place = {"buffer": self._staging, "offset": offset, "bytes_per_row": row, "rows_per_image": height}
            encoder.copy_texture_to_buffer({"texture": texture}, place, (width, height, 1))
            offset += height * row

    def read(self, *, truth: bool) -> tuple[Float16Array, Float32Array | None, UInt32Array | None]:
        """Wait for the copies: light (height, width, 4), distances and labels (height, width)."""
        (width, height), offset, found = self.size_px, 0, []
        copied = self._copied(truth)
        self._staging.map_sync(wgpu.MapMode.READ, 0, height * sum(row for _, row in copied))
        for _, row in copied:
            found.append(np.frombuffer(self._staging.read_mapped(offset, height * row), np.uint8).reshape(height, row))
            offset += height * row
        self._staging.unmap()
        light = np.ascontiguousarray(found[0][:, : width * 8]).view(np.float16).reshape(height, width, 4)
        if not truth:
            return light, None, None
        distances, labels = (np.ascontiguousarray(each[:, : width * 4]) for each in found[1:])
        return light, distances.view(np.float32), labels.view(np.uint32)

    def _copied(self, truth: bool) -> list[tuple[Any, int]]:
        """Textures, and bytes of their rows in the buffer."""
        others = [(texture, self._truth_row) for texture in (self.distances, self.labels)]
        return [(self.light, self._light_row), *(others if truth else [])]


def _padded(row: int) -> int:
    """Bytes of a row in a buffer that a texture is copied to: a multiple of 256."""
    return -(-row // 256) * 256


@dataclass(frozen=True)
class FramePasses:
    """Records the passes of one frame."""

    encoder: Any
    pipelines: Pipelines
    frame: Any
    """Bind group of the frame."""
    materials: Materials
    records: Any
    """The instance buffer."""
    draws: DrawList

    def shadows(self, target: Any, used_px: tuple[int, int]) -> None:
        """Depths from the sun, in the used columns and rows of the map."""
        render_pass = self._begin([], _cleared(target, "store") | {"depth_clear_value": 1.0}, self.frame)
        render_pass.set_scissor_rect(0, 0, *used_px)
        for mesh, count, first in self.draws.casters:
            render_pass.set_pipeline(self.pipelines.shadow[mesh.culling])
            mesh.draw(render_pass, count, first, attributes=False)
        render_pass.end()

    def light(self, targets: RenderTargets, frame: Any) -> None:
        """The image as luminance, labels and distances. `frame`: bind group of the frame with its light."""
        colours = [
            cleared_colour(targets.light, (0, 0, 0, 1)),
            cleared_colour(targets.labels, (0, 0, 0, 0)),
            cleared_colour(targets.distances, _NOWHERE),
        ]
        render_pass = self._begin(colours, _cleared(targets.depth, "discard"), frame)
        # Objects above the ground first: the ground they hide need not be shaded.
        lit = self.pipelines.lit[self.draws.looks_down]
        for either, batch in ((lit.near, self.draws.near), (lit.far, self.draws.far)):
            for mesh, count, first in batch:
                render_pass.set_pipeline(either[mesh.culling])
                mesh.draw(render_pass, count, first, attributes=True)
        render_pass.set_pipeline(lit.facade)
        render_pass.set_bind_group(1, self.materials.facades)
        for tile, record in self.draws.tiles:
            if tile.facades is not None:
                tile.facades.draw(render_pass, 1, record, attributes=True)
        render_pass.set_bind_group(1, self.materials.ground)
        render_pass.set_pipeline(lit.ground)
        for tile, pavement, record in self.draws.grounds:
            if tile.ground is not None:
                render_pass.set_bind_group(2, pavement.shading)
                tile.ground.draw(render_pass, 1, record, attributes=True)
        render_pass.set_pipeline(lit.patch)
        for each in self.draws.patches:
            render_pass.set_bind_group(2, each.around.shading)
            render_pass.set_bind_group(3, each.patch.shading)
            each.mesh.draw(render_pass, 1, each.record, attributes=True)
        for pipeline, (count, first) in (
            (self.pipelines.shade, self.draws.shades),
            (self.pipelines.strip, self.draws.strips),
        ):
            if count:
                render_pass.set_pipeline(pipeline)
                render_pass.draw(6, count, 0, first)
        if self.draws.sky:
            render_pass.set_pipeline(self.pipelines.sky)
            render_pass.draw(3)
        render_pass.end()

    def _begin(self, colours: list[dict[str, Any]], depth: dict[str, Any], frame: Any) -> Any:
        render_pass = self.encoder.begin_render_pass(color_attachments=colours, depth_stencil_attachment=depth)
        render_pass.set_bind_group(0, frame)
        render_pass.set_bind_group(1, self.materials.leaves)
        render_pass.set_vertex_buffer(0, self.records)
        return render_pass


def read(gpu: Gpu, texture: Any, size_px: tuple[int, int], dtype: type[np.generic], channels: int) -> AnyArray:
    """A texture's texels: (height, width, channels), or (height, width) of one channel."""
    width, height = size_px
    row = width * channels * np.dtype(dtype).itemsize
    layout = {"bytes_per_row": row, "rows_per_image": height}
    texels = gpu.queue.read_texture({"texture": texture}, layout, (width, height, 1))
    shape = (height, width) if channels == 1 else (height, width, channels)
    return np.frombuffer(texels, dtype=dtype).reshape(shape)


def cleared_colour(texture: Any, value: tuple[float, float, float, float]) -> dict[str, Any]:
    """A target filled with a value before it is drawn into."""
    return {"view": texture.create_view(), "clear_value": value, "load_op": "clear", "store_op": "store"}


def _cleared(texture: Any, store: str) -> dict[str, Any]:
    """A depth buffer with nothing nearer than infinity."""
    return {
        "view": texture.create_view(),
        "depth_clear_value": 0.0,
        "depth_load_op": "clear",
        "depth_store_op": store,
    }
