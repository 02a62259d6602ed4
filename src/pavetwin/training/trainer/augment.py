"""Random views: position, scale, mirror images, mosaics, colours. The random numbers are handed in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Final

import numpy as np
from PIL import Image

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.labels.boxes import PixelBox
from pavetwin.training.datasets.examples import Example, ExampleSet
from pavetwin.training.trainer.views import Change, ImagePart, LabelledView, view_of

Member = tuple[ExampleSet, Example]
"""An example, and the set that holds its picture."""

Photometric = Callable[[UInt8Array, np.random.Generator], UInt8Array]
"""A change of a picture (height, width, 3), by random numbers, that leaves every label true."""

MOSAIC_SPLIT: Final = (0.3, 0.7)
"""Where the four parts of a mosaic meet, as shares of its side."""

FOCUS: Final = 0.7
"""Share of native crops that show a labelled object, where the image has one."""


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """What varies. The values are those published for YOLOv8 where it has them."""

    size_px: int = 640
    """Side of the view."""
    native: bool = False
    """Crops at about the image's own resolution, where it is larger than the view; otherwise the whole image fits."""
    mosaic: float = 1.0
    """Share of views made of four images."""
    scale: float = 0.5
    """The scale varies from 1 − this to 1 + this."""
    mirror: float = 0.5
    """Share of images with left and right exchanged."""
    upside_down: float = 0.0
    """Share of images with top and bottom exchanged, but for those that are known to be taken from a vehicle."""
    hue: float = 0.015
    saturation: float = 0.7
    brightness: float = 0.4


def random_view(
    member: Member,
    others: Sequence[Member],
    options: ViewOptions,
    rng: np.random.Generator,
    photometric: Sequence[Photometric] = (),
) -> LabelledView:
    """A view of one image, or of four.

    Args:
        others: from which the other three of a mosaic are drawn.
        photometric: applied in order to what is shown of each synthetic image, before the colours of the view are
            varied. Their random numbers are their own: without them the rest of the view is the same.
    """
    plan = planned_view(member, others, options, rng)
    view = view_of(plan.parts, options.size_px, _changing(photometric, rng) if photometric else None)
    return replace(view, pixels=in_colours(view.pixels, plan.colours))


@dataclass(frozen=True, slots=True)
class ViewPlan:
    """A view before it is drawn."""

    parts: tuple[ImagePart, ...]
    colours: Float64Array | None
    """(3, 3) red, green and blue of the view, of those of the images; None changes nothing."""


def planned_view(member: Member, others: Sequence[Member], options: ViewOptions, rng: np.random.Generator) -> ViewPlan:
    """A view as `random_view` draws it."""
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


def _changing(photometric: Sequence[Photometric], rng: np.random.Generator) -> Change:
    (own,) = rng.spawn(1)

    def change(part: ImagePart, pixels: UInt8Array) -> UInt8Array:
        if part.example.is_synthetic:
            for each in photometric:
                pixels = each(pixels, own)
        return pixels

    return change


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


def vary_colours(pixels: UInt8Array, options: ViewOptions, rng: np.random.Generator) -> UInt8Array:
    """Hue turned, saturation and brightness scaled, each by a random amount."""
    return in_colours(pixels, varied_colours(options, rng))


def varied_colours(options: ViewOptions, rng: np.random.Generator) -> Float64Array | None:
    """The same as one matrix (3, 3) for all pixels; None where nothing varies."""
    spread = np.array([options.hue, options.saturation, options.brightness])
    if not spread.any():
        return None
    turn, saturate, brighten = rng.uniform(-1, 1, 3) * spread
    return np.asarray((1 + brighten) * _turned(2 * pi * turn) @ _saturated(1 + saturate))


def in_colours(pixels: UInt8Array, matrix: Float64Array | None) -> UInt8Array:
    """Pixels (height, width, 3) in the colours of a matrix (3, 3)."""
    if matrix is None:
        return pixels
    rows = np.hstack([matrix, np.zeros((3, 1))])
    return np.asarray(Image.fromarray(pixels).convert("RGB", tuple(rows.ravel().tolist())))


_LUMA: Final = np.array([0.213, 0.715, 0.072])
"""Of red, green and blue (ITU-R BT.709), as W3C's Filter Effects round them."""


def _saturated(scale: float) -> Float64Array:
    """Differences to the luma scaled: `saturate` of W3C's Filter Effects Module."""
    return scale * np.eye(3) + (1 - scale) * np.tile(_LUMA, (3, 1))


def _turned(angle_rad: float) -> Float64Array:
    """Colours turned about grey, at the same luma: `hueRotate` of W3C's Filter Effects Module."""
    across = np.array([[-0.213, -0.715, 0.928], [0.143, 0.140, -0.283], [-0.787, 0.715, 0.072]])
    grey = np.tile(_LUMA, (3, 1))
    return grey + np.cos(angle_rad) * (np.eye(3) - grey) + np.sin(angle_rad) * across
