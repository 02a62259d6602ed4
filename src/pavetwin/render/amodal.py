"""Amodal pixel counts: each labelled object is drawn without occluders, side by side in one atlas.

An object is drawn with the same triangles at the same sub-pixel positions as in the image, moved by whole pixels to
its cell of the atlas, and its pixels are counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import wgpu

from pavetwin.arrays import Float64Array, StructuredArray
from pavetwin.render.gpu import Gpu
from pavetwin.render.instances import RECORD
from pavetwin.render.meshes import GpuMesh
from pavetwin.render.passes import cleared_colour, read
from pavetwin.render.pipelines import LABEL_FORMAT, Pipelines
from pavetwin.render.projection import NEAR_M
from pavetwin.scene.view import View

_SIDE_PX: Final = 1024

_CLOSE_M: Final = 0.2  # Bodies with a corner nearer than this along the camera's axis may reach through the near plane


@dataclass(frozen=True)
class AmodalObject:
    """One labelled object to draw without occluders."""

    label: int
    mesh: GpuMesh
    record: StructuredArray
    """(1,) its instance record, as in the image."""
    corners: Float64Array
    """(8, 3) of a box around it, world frame."""
    mask: Any = None
    """Bind group of a defect's mask; None if all of its mesh is labelled."""
    single_sided: bool = False
    """Whether only the front faces of its triangles are drawn."""

    def pipeline(self, pipelines: Pipelines) -> Any:
        """The pipeline that draws this pass."""
        if self.mask is not None:
            return pipelines.amodal_patch
        return pipelines.amodal_culled if self.single_sided else pipelines.amodal


@dataclass(frozen=True)
class _AtlasCell:
    """Bounding box of an object in the image (x, y), and its corner in the atlas (left, top) [px]."""

    obj: AmodalObject
    x: int
    y: int
    width: int
    height: int
    left: int
    top: int


class AmodalAtlas:
    """Draws objects without occluders and counts their pixels."""

    def __init__(self, gpu: Gpu, pipelines: Pipelines) -> None:
        self._gpu, self._pipelines = gpu, pipelines
        self._target: Any = None
        self._size = (0, 0)
        self._records: Any = None

    def count(self, objects: Sequence[AmodalObject], view: View, frame: Any, margin_px: float) -> "AmodalCount":
        """The count of a frame's objects, prepared; it is used up before the next one is prepared.

        Args:
            objects: to count; those of one label are added up, so they must not overlap.
            view: of the image.
            frame: bind group of the frame.
            margin_px: how far the rolling shutter may move an object from its projected box.
        """
        cells = [cell for obj in objects if (cell := _atlas_cell(obj, view, margin_px)) is not None]
        self._ensure((max(_SIDE_PX, view.size_px[0]), max(_SIDE_PX, view.size_px[1])), len(cells))
        return AmodalCount(self, [obj.label for obj in objects], _pages(cells, self._size), view, frame)

    def read(self, page: list[_AtlasCell], found: dict[int, int]) -> None:
        """Add the pixels of the drawn page to those of its labels."""
        used = max(cell.top + cell.height for cell in page)
        seen = read(self._gpu, self._target, (self._size[0], used), np.uint32, 1)
        for cell in page:
            inside = seen[cell.top : cell.top + cell.height, cell.left : cell.left + cell.width]
            found[cell.obj.label] += int(np.count_nonzero(inside))

    def _ensure(self, size: tuple[int, int], objects: int) -> None:
        if self._size != size:
            if self._target is not None:
                self._gpu.free(self._target)
            self._target = self._gpu.target(size, LABEL_FORMAT, usage=wgpu.TextureUsage.COPY_SRC)
            self._size = size
        needed = max(objects, 64) * RECORD.itemsize
        self._records = self._gpu.grown(self._records, needed, wgpu.BufferUsage.VERTEX)

    def recorded(self, page: list[_AtlasCell], view: View, frame: Any) -> Any:
        """The commands that draw a page."""
        rows = np.concatenate([cell.obj.record for cell in page])
        rows["shift"] = [_shift(cell, view.size_px, self._size) for cell in page]
        self._gpu.queue.write_buffer(self._records, 0, rows.view(np.uint8))
        encoder = self._gpu.device.create_command_encoder()
        render_pass = encoder.begin_render_pass(color_attachments=[cleared_colour(self._target, (0, 0, 0, 0))])
        render_pass.set_bind_group(0, frame)
        render_pass.set_vertex_buffer(0, self._records)
        pipelines = self._pipelines
        chosen = [cell.obj.pipeline(pipelines) for cell in page]
        for pipeline in (pipelines.amodal, pipelines.amodal_culled, pipelines.amodal_patch):
            render_pass.set_pipeline(pipeline)
            for index, cell in enumerate(page):
                if chosen[index] is pipeline:
                    masked = cell.obj.mask is not None
                    if masked:
                        render_pass.set_bind_group(1, cell.obj.mask)
                    render_pass.set_scissor_rect(cell.left, cell.top, cell.width, cell.height)
                    cell.obj.mesh.draw(render_pass, 1, index, attributes=masked)
        render_pass.end()
        return encoder.finish()

    def submit(self, commands: Any) -> None:
        """Start drawing a page."""
        self._gpu.queue.submit([commands])


class AmodalCount:
    """The count of one frame's objects: started, it is drawn while the image is developed."""

    def __init__(
        self, atlas: AmodalAtlas, labels: Sequence[int], pages: list[list[_AtlasCell]], view: View, frame: Any
    ) -> None:
        self._atlas, self._labels, self._pages, self._view, self._frame = atlas, labels, pages, view, frame
        self._first = atlas.recorded(pages[0], view, frame) if pages else None

    def start(self) -> None:
        """Draw the first page; later ones need its place."""
        if self._pages:
            self._atlas.submit(self._first)

    def result(self) -> dict[int, int]:
        """Label → amodal pixels, 0 for objects outside the image."""
        found = dict.fromkeys(self._labels, 0)
        for number, page in enumerate(self._pages):
            if number:
                self._atlas.submit(self._atlas.recorded(page, self._view, self._frame))
            self._atlas.read(page, found)
        return found


def _atlas_cell(obj: AmodalObject, view: View, margin_px: float) -> _AtlasCell | None:
    """The part of the image that an object may cover; None if it is outside."""
    width, height = view.size_px
    points = view.to_camera(obj.corners)
    if (points[:, 2] < _CLOSE_M).any():
        points = _in_front(points, margin_px / view.focal_px)
    if len(points) == 0:
        return None
    pixels = points[:, :2] / points[:, 2:] * view.focal_px + view.principal_px
    low, high = pixels.min(axis=0) - margin_px, pixels.max(axis=0) + margin_px
    x, y = np.clip(np.floor(low), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(high), 0, (width, height)).astype(int)
    if right <= x or bottom <= y:
        return None
    return _AtlasCell(obj, int(x), int(y), int(right - x), int(bottom - y), 0, 0)


def _in_front(corners: Float64Array, reach_m: float) -> Float64Array:
    """Corners (n, 3) of what the near plane leaves of a convex body (m, 3), moved by up to `reach_m` along each axis.
    Camera frame."""
    ways = np.stack(np.meshgrid(*[(-reach_m, reach_m)] * 3), axis=-1).reshape(-1, 3)
    points = (corners[:, None] + ways).reshape(-1, 3)
    before, behind = points[points[:, 2] >= NEAR_M, None], points[None, points[:, 2] < NEAR_M]
    share = (before[..., 2:] - NEAR_M) / (before[..., 2:] - behind[..., 2:])
    cut = before + share * (behind - before)
    return np.concatenate([before[:, 0], cut.reshape(-1, 3)])


def _pages(cells: list[_AtlasCell], size: tuple[int, int]) -> list[list[_AtlasCell]]:
    """Pack cells into rows, the tallest first (shelf packing); a new page when one is full."""
    pages: list[list[_AtlasCell]] = []
    left, top, row_height = size[0], size[1], 0
    for cell in sorted(cells, key=lambda cell: -cell.height):
        if left + cell.width > size[0]:
            left, top = 0, top + row_height
            row_height = cell.height
        if top + cell.height > size[1]:
            pages.append([])
            left, top, row_height = 0, 0, cell.height
        pages[-1].append(_AtlasCell(cell.obj, cell.x, cell.y, cell.width, cell.height, left, top))
        left += cell.width
    return pages


def _shift(cell: _AtlasCell, image: tuple[int, int], atlas: tuple[int, int]) -> tuple[float, float, float, float]:
    """Scale and offset of clip positions that move an object by whole pixels from the image into its cell."""
    (width, height), (across, down) = image, atlas
    return (
        width / across,
        height / down,
        (width + 2 * (cell.left - cell.x)) / across - 1,
        1 - (height + 2 * (cell.top - cell.y)) / down,
    )
