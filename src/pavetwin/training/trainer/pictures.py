"""Decoded images in memory or on the training device, and views drawn on the device.

A processor core makes one or two hundred views per second, and a graphics card learns from thousands. So the processes
that prepare batches only decide which part of which image goes where, and the device resamples them. Resampling is
separable: a view is A P Bᵀ, with P the image and A, B the triangle filters of Pillow's BILINEAR. They are dense
matrices, which graphics cards multiply fastest."""

from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_start_method
from pathlib import Path
from typing import Final, Self

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from pavetwin.arrays import UInt8Array
from pavetwin.training.datasets.examples import SPLITS_USED, Example, ExampleSet
from pavetwin.training.trainer.views import GREY, Member, ViewPlan, shown_of

GIGABYTE: Final = 10**9


def is_inherited() -> bool:
    """Return whether worker processes inherit the memory of this process."""
    return get_start_method() == "fork"


@dataclass(frozen=True)
class HeldExampleSet(ExampleSet):
    """A dataset that decodes each image once and keeps it from epoch to epoch, within a limit.

    The first images stay. Dropping the least recently used one would never hit, since every epoch shows each image
    once.
    """

    most_bytes: int
    splits: tuple[str, ...] = SPLITS_USED
    """Splits whose images `hold` decodes."""
    _held: dict[str | tuple[int, int], UInt8Array] = field(default_factory=dict, compare=False, repr=False)

    @classmethod
    def of(cls, data: ExampleSet, most_bytes: int, splits: Sequence[str] = SPLITS_USED) -> Self:
        """Copy of a dataset that keeps its images."""
        return cls(data.path, data.fingerprint, data.examples, most_bytes, tuple(splits))

    @property
    def held_bytes(self) -> int:
        """Memory of the images, in bytes."""
        return sum(each.nbytes for each in self._held.values())

    def picture(self, example: Example) -> Image.Image:
        """An image in RGB.

        Raises:
            PaveTwinError: it is not readable, or its size differs from that in its labels.
        """
        if (known := self._held.get(example.place)) is not None:
            return Image.fromarray(known)
        picture = super().picture(example)
        if self.held_bytes + 3 * picture.width * picture.height <= self.most_bytes:
            self._held[example.place] = np.asarray(picture)
        return picture

    def hold(self, threads: int) -> None:
        """Decode images up to the limit now, so that forked processes inherit them.

        Raises:
            PaveTwinError: see `picture`.
        """
        room, chosen = self.most_bytes, []
        for example in self.examples:
            if example.split not in self.splits:
                continue
            room -= 3 * example.size_px[0] * example.size_px[1]
            if room < 0:
                break
            chosen.append(example)
        with ThreadPoolExecutor(threads) as pool:
            for example, picture in zip(chosen, pool.map(super().picture, chosen), strict=True):
                self._held[example.place] = np.asarray(picture)


PicturePlace = tuple[Path, tuple[int, int] | str]
"""A dataset, and the place of an image in it."""

PictureRows = dict[PicturePlace, tuple[int, int]]
"""Stack, one for each image size, and row of each image on the device."""

DECODERS: Final = 8  # Threads that decode images
WORKING_BYTES: Final = 2 * 10**9  # Memory for resampling, which limits the number of parts resampled at once

_COLUMNS: Final = 16
"""Values that describe a part: stack, row, box on the canvas (4), box of the image (4), window (4), mirrored, upside
down."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """Instructions for drawing views from images on the device."""

    size_px: int
    """Side of the views."""
    views: Tensor
    """(parts,) int64 index of the view of each part."""
    parts: Tensor
    """(parts, 16) float32, made by `drawing_of`."""
    colours: Tensor
    """(views, 3, 3) float32 colour matrix of each view."""


def drawing_of(plan: ViewPlan, rows: PictureRows, size_px: int) -> Drawing:
    """Drawing instructions of one view."""
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
    """Collate the instructions of single views for a batch."""
    counts = torch.tensor([len(each.parts) for each in drawings])
    return Drawing(
        drawings[0].size_px,
        torch.repeat_interleave(torch.arange(len(drawings)), counts),
        torch.cat([each.parts for each in drawings]),
        torch.cat([each.colours for each in drawings]),
    )


def place_of(data: ExampleSet, example: Example) -> PicturePlace:
    """Key of an image in `PictureRows`."""
    return data.path, example.place


def room_of(members: Sequence[Member], size_px: int) -> int:
    """Memory in bytes of images on the device, including the working memory for views of a given side."""
    held = sum(3 * example.size_px[0] * example.size_px[1] for _, example in members)
    return held + max([WORKING_BYTES, *(_room_of_part(*example.size_px, size_px) for _, example in members)])


def _room_of_part(width: int, height: int, size: int) -> int:
    """Memory in bytes for resampling one part: the image in bytes and in half precision, the filters with their
    intermediate values, and the results of the first and the second filter."""
    return 9 * width * height + 16 * size * (width + height) + 6 * size * height + 18 * size * size


class DevicePictures:
    """Decoded images on a device, one stack for each size."""

    def __init__(self, members: Sequence[Member], device: torch.device) -> None:
        """Raises:
        PaveTwinError: an image cannot be read.
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
                # Parts do not overlap on a canvas, so the order of the sums does not matter.
                canvas.index_add_(0, views, pixels.float())
                covered.index_add_(0, views, cover)
        canvas = canvas + GREY * (1 - covered)
        colours = drawing.colours.to(self._device)
        return (torch.einsum("vij,vjhw->vihw", colours, canvas) / 255).clamp(0, 1)

    def _resampled(self, stack: Tensor, parts: Tensor, size: int) -> tuple[Tensor, Tensor]:
        """Contribution of each part to its canvas, and its coverage, 0 or 1."""
        pictures = stack[parts[:, 1].long()].to(self._kind)
        across = _filters(parts[:, [2, 4, 6, 8, 10, 12, 14]], size, stack.shape[3])
        down = _filters(parts[:, [3, 5, 7, 9, 11, 13, 15]], size, stack.shape[2])
        cover = down.sum(dim=2)[:, None, :, None] * across.sum(dim=2)[:, None, None, :]
        narrowed = pictures @ across.to(self._kind).transpose(1, 2)[:, None]
        return down.to(self._kind)[:, None] @ narrowed, cover.round()


def _filters(parts: Tensor, size: int, length: int) -> Tensor:
    """(parts, size, length) float32: weight of each image pixel in each canvas pixel along one axis; 0 for canvas
    pixels outside the part.

    Args:
        parts: (parts, 7) first and last pixel of the canvas, begin and end in the image, window (2), mirrored.
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
    """Pixels (3, height, width)."""
    data, example = member
    return np.array(np.asarray(data.picture(example)).transpose(2, 0, 1))


def images_of(images: Tensor | Drawing, device: torch.device, pictures: DevicePictures | None = None) -> Tensor:
    """Images of a batch on the device, (batch, 3, height, width) float32 in 0 … 1.

    Args:
        pictures: images on the device, needed for drawing instructions.
    """
    if isinstance(images, Drawing):
        assert pictures is not None
        drawn = pictures.draw(images)
    else:
        drawn = images.to(device, non_blocking=True).float() / 255
    return drawn.to(memory_format=torch.channels_last)
