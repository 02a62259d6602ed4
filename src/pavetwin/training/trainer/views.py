"""Training views: parts of images, scaled, moved, mirrored and recoloured at random, with their labels.

A view is a canvas with parts of one or more images, each at one scale. Every object keeps its box and mask in its own
image, so that nothing is resampled twice. Random numbers are handed in."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float32Array, Float64Array, UInt8Array
from pavetwin.labels.boxes import FloatBox, PixelBox, share_within, within
from pavetwin.labels.class_names import CRACK_LABELS
from pavetwin.training.datasets.examples import Example, ExampleSet, Shape, TrueObject, mask_in

GREY: Final = 114
"""Level of the canvas outside images."""

LEAST_SHARE: Final = 0.3
"""Minimum share of an object's box within a view; objects below it are ignored, since they may not be recognisable."""

LEAST_CRACK_PX: Final = 24.0  # Longer side from which a part of a crack counts, whatever its share of the whole crack
LEAST_SIDE_PX: Final = 2.0  # Minimum longer side of a box in a view; smaller objects are ignored


@dataclass(frozen=True, slots=True)
class ImagePart:
    """Placement of an image in a view."""

    data: ExampleSet
    example: Example
    window: PixelBox
    """Maximum part of the canvas that it fills."""
    scale: float
    """Pixels of the canvas per pixel of the image."""
    left: float
    """Column of the image's left edge on the canvas, before mirroring."""
    top: float
    mirrored: bool = False
    """Mirrored left to right within the window."""
    upside_down: bool = False

    def on_canvas(self, box: FloatBox) -> FloatBox:
        """A box of the image in pixels of the canvas; it may extend beyond the window."""
        left, right = (self.left + self.scale * x for x in (box[0], box[2]))
        top, bottom = (self.top + self.scale * y for y in (box[1], box[3]))
        return self._mirrored((left, top, right, bottom))

    def in_image(self, box: FloatBox) -> FloatBox:
        """A box of the canvas in pixels of the image."""
        left, right = ((x - self.left) / self.scale for x in self._mirrored(box)[::2])
        top, bottom = ((y - self.top) / self.scale for y in self._mirrored(box)[1::2])
        return left, top, right, bottom

    def _mirrored(self, box: FloatBox) -> FloatBox:
        left, top, right, bottom = box
        if self.mirrored:
            left, right = self.window[0] + self.window[2] - right, self.window[0] + self.window[2] - left
        if self.upside_down:
            top, bottom = self.window[1] + self.window[3] - bottom, self.window[1] + self.window[3] - top
        return left, top, right, bottom


@dataclass(frozen=True, slots=True)
class SeenObject:
    """A labelled object in a view."""

    true: TrueObject
    box: FloatBox
    """Box around its visible part, in pixels of the canvas; without a mask, the visible part of its box."""
    is_ignored: bool
    part: ImagePart


@dataclass(frozen=True, slots=True)
class ViewLabels:
    """Labels of a view."""

    objects: tuple[SeenObject, ...]
    sources: frozenset[str]
    """Sources of the images."""


@dataclass(frozen=True, slots=True)
class LabelledView:
    """A picture for the network, and what is labelled in it."""

    pixels: UInt8Array
    """(height, width, 3) red, green, blue."""
    labels: ViewLabels

    @property
    def objects(self) -> tuple[SeenObject, ...]:
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


def view_of(parts: Sequence[ImagePart], size_px: int) -> LabelledView:
    """A canvas (size_px, size_px) with its parts and labels.

    Raises:
        PaveTwinError: an image cannot be read.
    """
    return LabelledView(drawn(parts, size_px), labels_of(parts))


def labels_of(parts: Sequence[ImagePart]) -> ViewLabels:
    """Labels of a view."""
    objects = tuple(seen for part in parts for seen in _seen(part))
    return ViewLabels(objects, frozenset(part.example.source for part in parts))


def drawn(parts: Sequence[ImagePart], size_px: int) -> UInt8Array:
    """Draw parts on a canvas (size_px, size_px, 3).

    Raises:
        PaveTwinError: an image cannot be read.
    """
    canvas = np.full((size_px, size_px, 3), GREY, dtype=np.uint8)
    for part in parts:
        _draw(part, canvas)
    return canvas


def shown_of(part: ImagePart) -> tuple[PixelBox, FloatBox] | None:
    """Whole pixels of the canvas within the image, before mirroring, and the part of the image they show, or None."""
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


def _draw(part: ImagePart, canvas: UInt8Array) -> None:
    """Fill the part's window; resample the image once."""
    picture = part.data.picture(part.example)
    found = shown_of(part)
    if found is None:
        return
    (left, top, right, bottom), source = found
    first, last = part.window[:2], part.window[2:]
    shown = np.asarray(picture.resize((right - left, bottom - top), Image.Resampling.BILINEAR, box=source))
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
        is_long_crack = true.category in CRACK_LABELS and side >= LEAST_CRACK_PX
        is_cut = share_within(whole, window) < LEAST_SHARE and not is_long_crack
        found.append(SeenObject(true, inside, true.is_ignored or is_small or is_cut, part))
    return found


def _tightened(part: ImagePart, shape: Shape, seen: FloatBox) -> FloatBox | None:
    """Box around the part of a mask within a visible box of the canvas; None if that part is empty."""
    left, top, right, bottom = part.in_image(seen)
    window = (int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom)))
    mask = mask_in(shape, window)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    x, y = float(window[0]), float(window[1])
    return within(part.on_canvas((x + columns[0], y + rows[0], x + columns[-1] + 1, y + rows[-1] + 1)), seen)


def mask_of(seen: SeenObject, region: FloatBox, side_px: int) -> Float32Array | None:
    """Share of each pixel of a region that an object covers: (side_px, side_px) in 0 … 1; None without a mask.

    Args:
        region: in pixels of the canvas; pixels outside the object's box are not covered.
    """
    if seen.true.shape is None:
        return None
    left, top, right, bottom = seen.part.in_image(region)
    window = (int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom)))
    pixels = Image.fromarray(mask_in(seen.true.shape, window))
    box = (left - window[0], top - window[1], right - window[0], bottom - window[1])
    share = np.asarray(pixels.resize((side_px, side_px), Image.Resampling.BOX, box=box), dtype=np.float32) / np.float32(
        255
    )
    if seen.part.mirrored:
        share = share[:, ::-1]
    return share[::-1] if seen.part.upside_down else share


Member = tuple[ExampleSet, Example]
"""An example, and the set that holds its image."""

MOSAIC_SPLIT: Final = (0.3, 0.7)  # Range of the point at which the four parts of a mosaic meet, as shares of its side
FOCUS: Final = 0.7  # Share of native crops aimed at a labelled object, if the image has one


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """Augmentation of training views, with the values published for YOLOv8 where it has them."""

    size_px: int = 640
    """Side of the view, in pixels."""
    native: bool = False
    """Crop images larger than the view at about their own resolution; otherwise fit the whole image."""
    mosaic: float = 1.0
    """Share of views made of four images."""
    scale: float = 0.5
    """Scales vary from 1 − this to 1 + this."""
    mirror: float = 0.5
    """Share of images mirrored left to right."""
    upside_down: float = 0.0
    """Share of images mirrored top to bottom, except those taken from a vehicle."""
    hue: float = 0.015
    saturation: float = 0.7
    brightness: float = 0.4


def random_view(
    member: Member, others: Sequence[Member], options: ViewOptions, rng: np.random.Generator
) -> LabelledView:
    """A view of one image, or a mosaic of four.

    Args:
        others: pool of the other three images of a mosaic.
    """
    plan = planned_view(member, others, options, rng)
    view = view_of(plan.parts, options.size_px)
    return replace(view, pixels=in_colours(view.pixels, plan.colours))


@dataclass(frozen=True, slots=True)
class ViewPlan:
    """A view before it is drawn."""

    parts: tuple[ImagePart, ...]
    colours: Float64Array | None
    """(3, 3) matrix from red, green and blue of the images to those of the view; None changes nothing."""


def planned_view(member: Member, others: Sequence[Member], options: ViewOptions, rng: np.random.Generator) -> ViewPlan:
    """Layout and colours of a view of `random_view`."""
    size = options.size_px
    windows: list[PixelBox] = [(0, 0, size, size)]
    members = [member]
    if rng.random() < options.mosaic:
        x, y = (int(size * each) for each in rng.uniform(*MOSAIC_SPLIT, 2))
        windows = [(0, 0, x, y), (x, 0, size, y), (0, y, x, size), (x, y, size, size)]
        members += [others[at] for at in rng.integers(len(others), size=3)]
        members = [members[at] for at in rng.permutation(4)]
    parts = tuple(_part(one, window, options, rng) for one, window in zip(members, windows, strict=True))
    return ViewPlan(parts, varied_colours(options, rng))


def _part(member: Member, window: PixelBox, options: ViewOptions, rng: np.random.Generator) -> ImagePart:
    data, example = member
    size = np.array(example.size_px, dtype=np.float64)
    room = np.array([window[2] - window[0], window[3] - window[1]], dtype=np.float64)
    base = options.size_px / size.max()
    if options.native:
        base = max(base, 1.0)
    scale = base * rng.uniform(1 - options.scale, 1 + options.scale)
    spare = room - scale * size
    offset = rng.uniform(0, 1, 2) * spare
    objects = [each.box for each in example.objects if not each.is_ignored]
    wants = rng.random() < FOCUS
    if options.native and objects and wants:
        box = objects[int(rng.integers(len(objects)))]
        point = np.array([rng.uniform(box[0], box[2]), rng.uniform(box[1], box[3])])
        aimed = rng.uniform(0.2, 0.8, 2) * room - scale * point
        offset = np.clip(aimed, np.minimum(spare, 0), np.maximum(spare, 0))
    return ImagePart(
        data,
        example,
        window,
        float(scale),
        float(window[0] + np.round(offset[0])),
        float(window[1] + np.round(offset[1])),
        mirrored=bool(rng.random() < options.mirror),
        upside_down=bool(rng.random() < options.upside_down) and not example.is_from_road,
    )


def varied_colours(options: ViewOptions, rng: np.random.Generator) -> Float64Array | None:
    """Matrix (3, 3) that turns the hue and scales saturation and brightness by random amounts; None for no change."""
    spread = np.array([options.hue, options.saturation, options.brightness])
    if not spread.any():
        return None
    turn, saturate, brighten = rng.uniform(-1, 1, 3) * spread
    return np.asarray((1 + brighten) * _turned(2 * pi * turn) @ _saturated(1 + saturate))


def in_colours(pixels: UInt8Array, matrix: Float64Array | None) -> UInt8Array:
    """Pixels (height, width, 3) multiplied by a colour matrix (3, 3)."""
    if matrix is None:
        return pixels
    rows = np.hstack([matrix, np.zeros((3, 1))])
    return np.asarray(Image.fromarray(pixels).convert("RGB", tuple(rows.ravel().tolist())))


_LUMA: Final = np.array([0.213, 0.715, 0.072])
"""Luma of red, green and blue (ITU-R BT.709), rounded as in W3C's Filter Effects Module."""


def _saturated(scale: float) -> Float64Array:
    """Scale differences from the luma: `saturate` of W3C's Filter Effects Module."""
    return scale * np.eye(3) + (1 - scale) * np.tile(_LUMA, (3, 1))


def _turned(angle_rad: float) -> Float64Array:
    """Rotate colours about grey, at constant luma: `hueRotate` of W3C's Filter Effects Module."""
    across = np.array([[-0.213, -0.715, 0.928], [0.143, 0.140, -0.283], [-0.787, 0.715, 0.072]])
    grey = np.tile(_LUMA, (3, 1))
    return grey + np.cos(angle_rad) * (np.eye(3) - grey) + np.sin(angle_rad) * across
