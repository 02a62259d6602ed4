"""Pictures as the network sees them: parts of images, scaled, moved and mirrored, and what is labelled there.

A view is a canvas with parts of one or more images, each at one scale. Every object keeps its own
box and mask in its image, so that nothing is resampled twice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float32Array, UInt8Array
from pavetwin.labels.boxes import FloatBox, PixelBox, share_within, within
from pavetwin.perception.classes import CRACKS
from pavetwin.training.datasets.examples import Example, ExampleSet, Shape, TrueObject, mask_in

GREY: Final = 114
"""Of a canvas where no image is."""

LEAST_SHARE: Final = 0.3
"""Of an object's box that a view must show; what shows less is ignored, since it may or may not be told."""

LEAST_CRACK_PX: Final = 24.0
"""Longer side of a part of a crack that is told for what it is, however long the rest is."""

LEAST_SIDE_PX: Final = 2.0
"""Of the longer side of a box in a view; what is smaller is ignored."""


@dataclass(frozen=True, slots=True)
class ImagePart:
    """An image in a view."""

    data: ExampleSet
    example: Example
    window: PixelBox
    """The part of the canvas that it fills at most."""
    scale: float
    """Pixels of the canvas for a pixel of the image."""
    left: float
    """Column of the canvas at which the image's left edge lies, before it is mirrored."""
    top: float
    mirrored: bool = False
    """Left and right are exchanged within the window."""
    upside_down: bool = False

    def on_canvas(self, box: FloatBox) -> FloatBox:
        """A box of the image, in pixels of the canvas; it may reach out of the window."""
        left, right = (self.left + self.scale * x for x in (box[0], box[2]))
        top, bottom = (self.top + self.scale * y for y in (box[1], box[3]))
        if self.mirrored:
            left, right = self.window[0] + self.window[2] - right, self.window[0] + self.window[2] - left
        if self.upside_down:
            top, bottom = self.window[1] + self.window[3] - bottom, self.window[1] + self.window[3] - top
        return left, top, right, bottom

    def in_image(self, box: FloatBox) -> FloatBox:
        """A box of the canvas, in pixels of the image."""
        left, top, right, bottom = box
        if self.mirrored:
            left, right = self.window[0] + self.window[2] - right, self.window[0] + self.window[2] - left
        if self.upside_down:
            top, bottom = self.window[1] + self.window[3] - bottom, self.window[1] + self.window[3] - top
        return (
            (left - self.left) / self.scale,
            (top - self.top) / self.scale,
            (right - self.left) / self.scale,
            (bottom - self.top) / self.scale,
        )


@dataclass(frozen=True, slots=True)
class SeenObject:
    """A labelled thing in a view."""

    true: TrueObject
    box: FloatBox
    """Around what is seen of it, in pixels of the canvas; where it has no mask, the part of its box that is seen."""
    is_ignored: bool
    part: ImagePart


@dataclass(frozen=True, slots=True)
class ViewLabels:
    """What is labelled in a view."""

    objects: tuple[SeenObject, ...]
    sources: frozenset[str]
    """Of its images."""


@dataclass(frozen=True, slots=True)
class LabelledView:
    """A picture for the network, and what is labelled in it."""

    pixels: UInt8Array
    """(height, width, 3) red, green, blue."""
    labels: ViewLabels

    @property
    def objects(self) -> tuple[SeenObject, ...]:
        """What is labelled."""
        return self.labels.objects


def fitted(data: ExampleSet, example: Example, size_px: int) -> ImagePart:
    """The whole image in the middle of a square canvas (letterbox)."""
    width, height = example.size_px
    scale = size_px / max(width, height)
    left, top = (size_px - scale * width) / 2, (size_px - scale * height) / 2
    return ImagePart(data, example, (0, 0, size_px, size_px), scale, float(round(left)), float(round(top)))


def tiles(data: ExampleSet, example: Example, size_px: int) -> list[ImagePart]:
    """The image at its own resolution, cut into the fewest squares that cover it, which overlap evenly."""

    def starts(length: int) -> list[int]:
        count = max(1, -(-length // size_px))
        free = max(0, length - size_px)
        return [round(free * at / max(1, count - 1)) for at in range(count)]

    width, height = example.size_px
    window = (0, 0, size_px, size_px)
    return [ImagePart(data, example, window, 1.0, -float(x), -float(y)) for y in starts(height) for x in starts(width)]


Change = Callable[[ImagePart, UInt8Array], UInt8Array]
"""Of the pixels (height, width, 3) that a view shows of an image; they stay where they are."""


def view_of(parts: Sequence[ImagePart], size_px: int, change: Change | None = None) -> LabelledView:
    """The canvas (size_px, size_px) with its parts.

    Args:
        change: of each image as it is shown, before it is mirrored.

    Raises:
        PaveTwinError: a picture cannot be read.
    """
    return LabelledView(drawn(parts, size_px, change), labels_of(parts))


def labels_of(parts: Sequence[ImagePart]) -> ViewLabels:
    """What is labelled in a view."""
    objects = tuple(seen for part in parts for seen in _seen(part))
    return ViewLabels(objects, frozenset(part.example.source for part in parts))


def drawn(parts: Sequence[ImagePart], size_px: int, change: Change | None = None) -> UInt8Array:
    """The canvas (size_px, size_px, 3) with its parts; for `change` and errors see `view_of`."""
    canvas = np.full((size_px, size_px, 3), GREY, dtype=np.uint8)
    for part in parts:
        _draw(part, canvas, change)
    return canvas


def shown_of(part: ImagePart) -> tuple[PixelBox, FloatBox] | None:
    """The whole pixels of the canvas that lie on the image, before it is mirrored, and the part of the image that they
    show; None where there are none."""
    width, height = part.example.size_px
    first, last = part.window[:2], part.window[2:]
    left = max(first[0], round(part.left))
    top = max(first[1], round(part.top))
    right = min(last[0], round(part.left + part.scale * width))
    bottom = min(last[1], round(part.top + part.scale * height))
    if left >= right or top >= bottom:
        return None
    source = (
        max(0.0, (left - part.left) / part.scale),
        max(0.0, (top - part.top) / part.scale),
        min(float(width), (right - part.left) / part.scale),
        min(float(height), (bottom - part.top) / part.scale),
    )
    return (left, top, right, bottom), source


def _draw(part: ImagePart, canvas: UInt8Array, change: Change | None) -> None:
    """Fill the part's window, resampling the image once."""
    picture = part.data.picture(part.example)
    found = shown_of(part)
    if found is None:
        return
    (left, top, right, bottom), source = found
    first, last = part.window[:2], part.window[2:]
    shown = np.asarray(picture.resize((right - left, bottom - top), Image.Resampling.BILINEAR, box=source))
    if change is not None:
        shown = change(part, shown)
    if part.mirrored:
        shown, left, right = shown[:, ::-1], first[0] + last[0] - right, first[0] + last[0] - left
    if part.upside_down:
        shown, top, bottom = shown[::-1], first[1] + last[1] - bottom, first[1] + last[1] - top
    canvas[top:bottom, left:right] = shown


def _seen(part: ImagePart) -> list[SeenObject]:
    window: FloatBox = (*map(float, part.window),)  # type: ignore[assignment]
    found = []
    for true in part.example.objects:
        whole = part.on_canvas(true.box)
        inside = within(whole, window)
        if inside is None:
            continue
        if inside != whole and true.shape is not None:
            inside = _tightened(part, true.shape, inside)
            if inside is None:
                continue
        side = max(inside[2] - inside[0], inside[3] - inside[1])
        is_small = side < LEAST_SIDE_PX
        is_told = true.category in CRACKS and side >= LEAST_CRACK_PX
        is_cut = share_within(whole, window) < LEAST_SHARE and not is_told
        found.append(SeenObject(true, inside, true.is_ignored or is_small or is_cut, part))
    return found


def _tightened(part: ImagePart, shape: Shape, seen: FloatBox) -> FloatBox | None:
    """The box around what is seen of a mask, within the box of the canvas that is seen; None where nothing is."""
    left, top, right, bottom = part.in_image(seen)
    window = (int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom)))
    mask = mask_in(shape, window)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    x, y = float(window[0]), float(window[1])
    return within(part.on_canvas((x + columns[0], y + rows[0], x + columns[-1] + 1, y + rows[-1] + 1)), seen)


def mask_of(seen: SeenObject, region: FloatBox, side_px: int) -> Float32Array | None:
    """The share of each pixel of a region that an object covers: (side_px, side_px) in 0 … 1; None without a mask.

    Args:
        region: in pixels of the canvas; what lies out of the object's box is not covered.
    """
    if seen.true.shape is None:
        return None
    left, top, right, bottom = seen.part.in_image(region)
    # Whole pixels around the region: beyond the image and beyond the object there is nothing.
    window = (int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom)))
    pixels = Image.fromarray(mask_in(seen.true.shape, window))
    box = (left - window[0], top - window[1], right - window[0], bottom - window[1])
    share = np.asarray(pixels.resize((side_px, side_px), Image.Resampling.BOX, box=box), dtype=np.float32) / np.float32(
        255
    )
    if seen.part.mirrored:
        share = share[:, ::-1]
    return share[::-1] if seen.part.upside_down else share
