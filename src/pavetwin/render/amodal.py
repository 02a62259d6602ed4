"""What each labelled thing would cover if nothing stood before it: drawn alone, side by side in one atlas.

Every thing is drawn by the same triangles at the same places between pixels as in the picture, moved by whole pixels to
a room of its own, and its pixels are counted.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import wgpu

from pavetwin.arrays import Float64Array, StructuredArray
from pavetwin.render.gpu import Gpu
from pavetwin.render.meshes import GpuMesh
from pavetwin.render.passes import read
from pavetwin.render.pipelines import LABEL_FORMAT, Pipelines
from pavetwin.scene.view import View

_SIDE_PX: Final = 1024


@dataclass(frozen=True)
class AmodalObject:
    """One labelled thing."""

    label: int
    mesh: GpuMesh
    record: StructuredArray
    """(1,) its instance, as in the picture."""
    corners: Float64Array
    """(8, 3) of a box around it, world frame."""
    mask: Any = None
    """Bind group of a defect's mask; None for what is labelled all over."""


@dataclass(frozen=True)
class _AtlasCell:
    """Where a thing lies in the picture and in the atlas [px]."""

    thing: AmodalObject
    x: int
    y: int
    width: int
    height: int
    left: int
    top: int


class AmodalAtlas:
    """Draws things alone and counts their pixels."""

    def __init__(self, gpu: Gpu, pipelines: Pipelines) -> None:
        self._gpu, self._pipelines = gpu, pipelines
        self._target: Any = None
        self._size = (0, 0)
        self._records: Any = None

    def count(self, things: Sequence[AmodalObject], view: View, frame: Any, margin_px: float) -> dict[int, int]:
        """Label → pixels, 0 for what lies outside the picture.

        Args:
            things: labelled; several of one label count together where they do not overlap.
            view: of the picture.
            frame: bind group of the frame.
            margin_px: how far rolling rows may move a thing from where its box is projected.
        """
        found = {thing.label: 0 for thing in things}
        rooms = [room for thing in things if (room := _room(thing, view, margin_px)) is not None]
        self._ensure((max(_SIDE_PX, view.size_px[0]), max(_SIDE_PX, view.size_px[1])), len(rooms))
        for page in _pages(rooms, self._size):
            self._draw(page, view, frame)
            used = max(room.top + room.height for room in page)
            seen = read(self._gpu, self._target, (self._size[0], used), np.uint32, 1)
            for room in page:
                inside = seen[room.top : room.top + room.height, room.left : room.left + room.width]
                found[room.thing.label] += int(np.count_nonzero(inside))
        return found

    def _ensure(self, size: tuple[int, int], things: int) -> None:
        if self._size != size:
            if self._target is not None:
                self._gpu.free(self._target)
            self._target = self._gpu.target(size, LABEL_FORMAT, usage=wgpu.TextureUsage.COPY_SRC)
            self._size = size
        needed = max(things, 64) * 112
        if self._records is None or self._records.size < needed:
            if self._records is not None:
                self._gpu.free(self._records)
            self._records = self._gpu.empty_buffer(2 * needed, wgpu.BufferUsage.VERTEX)

    def _draw(self, page: list[_AtlasCell], view: View, frame: Any) -> None:
        rows = np.concatenate([room.thing.record for room in page])
        rows["shift"] = [_shift(room, view.size_px, self._size) for room in page]
        self._gpu.queue.write_buffer(self._records, 0, rows.view(np.uint8))
        encoder = self._gpu.device.create_command_encoder()
        colour = {
            "view": self._target.create_view(),
            "clear_value": (0, 0, 0, 0),
            "load_op": "clear",
            "store_op": "store",
        }
        render_pass = encoder.begin_render_pass(color_attachments=[colour])
        render_pass.set_bind_group(0, frame)
        render_pass.set_vertex_buffer(0, self._records)
        for masked in (False, True):
            render_pass.set_pipeline(self._pipelines.alone_patch if masked else self._pipelines.alone)
            for index, room in enumerate(page):
                if (room.thing.mask is not None) == masked:
                    if masked:
                        render_pass.set_bind_group(1, room.thing.mask)
                    render_pass.set_scissor_rect(room.left, room.top, room.width, room.height)
                    room.thing.mesh.draw(render_pass, 1, index, attributes=masked)
        render_pass.end()
        self._gpu.queue.submit([encoder.finish()])


def _room(thing: AmodalObject, view: View, margin_px: float) -> _AtlasCell | None:
    """The part of the picture that a thing may cover."""
    width, height = view.size_px
    if (view.to_camera(thing.corners)[:, 2] < 0.2).any():
        low, high = np.zeros(2), np.array([width, height], dtype=np.float64)
        if (view.to_camera(thing.corners)[:, 2] < 0).all():
            return None
    else:
        pixels = view.project(thing.corners)
        low, high = pixels.min(axis=0) - margin_px, pixels.max(axis=0) + margin_px
    x, y = np.clip(np.floor(low), 0, (width, height)).astype(int)
    right, bottom = np.clip(np.ceil(high), 0, (width, height)).astype(int)
    if right <= x or bottom <= y:
        return None
    return _AtlasCell(thing, int(x), int(y), int(right - x), int(bottom - y), 0, 0)


def _pages(rooms: list[_AtlasCell], size: tuple[int, int]) -> list[list[_AtlasCell]]:
    """Rooms side by side on shelves, the tallest first; a new page where one is full."""
    pages: list[list[_AtlasCell]] = []
    left, top, spatial_index = size[0], size[1], 0
    for room in sorted(rooms, key=lambda room: -room.height):
        if left + room.width > size[0]:
            left, top = 0, top + spatial_index
            spatial_index = room.height
        if top + room.height > size[1]:
            pages.append([])
            left, top, spatial_index = 0, 0, room.height
        pages[-1].append(_AtlasCell(room.thing, room.x, room.y, room.width, room.height, left, top))
        left += room.width
    return pages


def _shift(room: _AtlasCell, picture: tuple[int, int], atlas: tuple[int, int]) -> tuple[float, float, float, float]:
    """Scale and offset of clip positions that move a thing by whole pixels from the picture into its room."""
    (width, height), (across, down) = picture, atlas
    return (
        width / across,
        height / down,
        (width + 2 * (room.left - room.x)) / across - 1,
        1 - (height + 2 * (room.top - room.y)) / down,
    )
