"""Pictures held on the device that trains, and views that are drawn of them there.

Making views is most of the work beside a graphics card: a processor's core makes a hundred or two in a second, and a
card learns from thousands. So the processes that prepare batches say which part of which picture goes where, and the
device resamples them. Resampling is separable: a view is A P Bᵀ, with P the picture and A, B the triangle filters of
Pillow's `BILINEAR`, row for row as it computes them. They are dense here, since that is what graphics cards multiply
fastest.
"""

from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import torch
from torch import Tensor

from pavetwin.arrays import UInt8Array
from pavetwin.training.datasets.examples import Example, ExampleSet
from pavetwin.training.trainer.augment import Member, ViewPlan
from pavetwin.training.trainer.views import GREY, shown_of

PicturePlace = tuple[Path, tuple[int, int] | str]
"""A dataset, and where a picture is in it."""

PictureRows = dict[PicturePlace, tuple[int, int]]
"""Where a picture is held: which of the stacks, one for each size, and which row of it."""

DECODERS: Final = 8
"""Threads that decode pictures."""

WORKING_BYTES: Final = 2 * 10**9
"""Room in which parts are resampled, as many at once as it holds."""

_COLUMNS: Final = 16
"""Numbers that say how a part is drawn: stack, row, box on the canvas (4), box of the picture (4), window (4), and
whether it is mirrored and upside down."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """How views are to be drawn of pictures that the device holds."""

    size_px: int
    """Side of the views."""
    views: Tensor
    """(parts,) int64 index of the view."""
    parts: Tensor
    """(parts, 16) float32, made by `drawing_of`."""
    colours: Tensor
    """(views, 3, 3) float32 red, green and blue of the view, of those of the pictures."""


def drawing_of(plan: ViewPlan, rows: PictureRows, size_px: int) -> Drawing:
    """How one view is drawn."""
    found = []
    for part in plan.parts:
        shown = shown_of(part)
        if shown is not None:
            flips = (float(part.mirrored), float(part.upside_down))
            found.append((*rows[place_of(part.data, part.example)], *shown[0], *shown[1], *part.window, *flips))
    parts = torch.tensor(found, dtype=torch.float32).reshape(-1, _COLUMNS)
    colours = np.eye(3) if plan.colours is None else plan.colours
    return Drawing(
        size_px, torch.zeros(len(parts), dtype=torch.int64), parts, torch.tensor(colours, dtype=torch.float32)[None]
    )


def drawn_together(drawings: Sequence[Drawing]) -> Drawing:
    """The drawings of single views as one of a batch."""
    counts = torch.tensor([len(each.parts) for each in drawings])
    return Drawing(
        drawings[0].size_px,
        torch.repeat_interleave(torch.arange(len(drawings)), counts),
        torch.cat([each.parts for each in drawings]),
        torch.cat([each.colours for each in drawings]),
    )


def place_of(data: ExampleSet, example: Example) -> PicturePlace:
    """What a picture is found by."""
    return data.path, example.place


def room_of(members: Sequence[Member], size_px: int) -> int:
    """Bytes that pictures take on the device, with the room in which views of a side are drawn."""
    held = sum(3 * example.size_px[0] * example.size_px[1] for _, example in members)
    return held + max([WORKING_BYTES, *(_room_of_part(*example.size_px, size_px) for _, example in members)])


def _room_of_part(width: int, height: int, size: int) -> int:
    """Bytes in which a part of a picture is resampled: the picture in bytes and in half precision, the filters with
    what they are made of, and what comes of the first and of the second."""
    return 9 * width * height + 16 * size * (width + height) + 6 * size * height + 18 * size * size


class DevicePictures:
    """Decoded pictures on a device, those of one size in one stack."""

    def __init__(self, members: Sequence[Member], device: torch.device) -> None:
        """Raises:
        PaveTwinError: a picture cannot be read.
        """
        by_size: dict[tuple[int, int], list[Member]] = defaultdict(list)
        for member in members:
            by_size[member[1].size_px].append(member)
        if device.type == "cuda":
            torch.backends.cuda.matmul.allow_fp16_reduced_precision_reduction = False
        self._device = device
        self._stacks: list[Tensor] = []
        self.rows: PictureRows = {}
        with ThreadPoolExecutor(DECODERS) as pool:
            for stack, ((width, height), of_size) in enumerate(by_size.items()):
                held = torch.empty(len(of_size), 3, height, width, dtype=torch.uint8, device=device)
                for row, pixels in enumerate(pool.map(_decoded, of_size)):
                    held[row] = torch.from_numpy(pixels)
                self._stacks.append(held)
                self.rows |= {place_of(*member): (stack, row) for row, member in enumerate(of_size)}
        self._kind = torch.float16 if device.type == "cuda" else torch.float32

    def draw(self, drawing: Drawing) -> Tensor:
        """The views: (views, 3, height, width) float32 in 0 … 1."""
        count, size = len(drawing.colours), drawing.size_px
        canvas = torch.zeros(count, 3, size, size, device=self._device)
        covered = torch.zeros(count, 1, size, size, device=self._device)
        stacks = drawing.parts[:, 0].long()
        for at, stack in enumerate(self._stacks):
            most = max(1, WORKING_BYTES // _room_of_part(stack.shape[3], stack.shape[2], size))
            for chosen in torch.nonzero(stacks == at).squeeze(1).split(most):
                views = drawing.views[chosen].to(self._device)
                parts = drawing.parts[chosen].to(self._device)
                pixels, cover = self._resampled(stack, parts, size)
                # Each pixel of a canvas is of one part at most, so that the order of the sums changes nothing.
                canvas.index_add_(0, views, pixels.float())
                covered.index_add_(0, views, cover)
        canvas = canvas + GREY * (1 - covered)
        colours = drawing.colours.to(self._device)
        return (torch.einsum("vij,vjhw->vihw", colours, canvas) / 255).clamp(0, 1)

    def _resampled(self, stack: Tensor, parts: Tensor, size: int) -> tuple[Tensor, Tensor]:
        """What each part puts on its canvas, nothing elsewhere, and where it does: 0 or 1."""
        pictures = stack[parts[:, 1].long()].to(self._kind)
        across = _filters(parts[:, [2, 4, 6, 8, 10, 12, 14]], size, stack.shape[3])
        down = _filters(parts[:, [3, 5, 7, 9, 11, 13, 15]], size, stack.shape[2])
        cover = down.sum(dim=2)[:, None, :, None] * across.sum(dim=2)[:, None, None, :]
        narrowed = pictures @ across.to(self._kind).transpose(1, 2)[:, None]
        return down.to(self._kind)[:, None] @ narrowed, cover.round()


def _filters(parts: Tensor, size: int, length: int) -> Tensor:
    """(parts, size, length) float32: the share that each pixel of the picture has in each of the canvas, along one
    axis; 0 for pixels of the canvas that the part does not fill.

    Args:
        parts: (parts, 7) first and last pixel of the canvas, begin and end in the picture, window, whether mirrored.
    """
    first, last, begin, end, window, window_end, is_mirrored = (each[:, None] for each in parts.unbind(dim=1))
    at = torch.arange(size, dtype=parts.dtype, device=parts.device)[None]
    at = torch.where(is_mirrored > 0, window + window_end - 1 - at, at)
    is_filled = (at >= first) & (at < last)
    step = (end - begin) / (last - first)
    centres = begin + (at - first + 0.5) * step
    reach = step.clamp(min=1)
    pixels = torch.arange(length, dtype=torch.float32, device=parts.device) + 0.5
    apart = (pixels - centres[..., None]).abs() / reach[..., None]
    shares = (1 - apart).clamp(min=0)
    return torch.where(is_filled[..., None], shares / shares.sum(dim=2, keepdim=True).clamp(min=1e-6), 0.0)


def _decoded(member: Member) -> UInt8Array:
    """(3, height, width)."""
    data, example = member
    return np.array(np.asarray(data.picture(example)).transpose(2, 0, 1))


def images_of(images: Tensor | Drawing, device: torch.device, pictures: DevicePictures | None = None) -> Tensor:
    """The images of a batch on the device, (batch, 3, height, width) float32 in 0 … 1.

    Args:
        pictures: of which drawings are made.
    """
    if isinstance(images, Drawing):
        assert pictures is not None
        drawn = pictures.draw(images)
    else:
        drawn = images.to(device, non_blocking=True).float() / 255
    return drawn.to(memory_format=torch.channels_last)
