"""Changed copies of images: the drawn change, the labels it leaves, and the changed picture.

A copy is flipped first, then rotated about the middle. A rotated picture is cropped to the largest rectangle that shows
nothing but the picture itself, so no corner needs filling.

The share of an annotation's area that stays visible decides its fate:

1. From `LEAST_SHARE` on it stays, with the box around its visible part.
2. Below that it becomes ignored: neither an object nor background.
3. Below `GONE_SHARE` it is left out.

The area is that of the outline if there is one, else of the box. Without an outline the new box encloses the rotated
box, since the object's place within it is unknown.

Pictures are changed by Albumentations 2.0.8 (MIT), which only this file knows: it is no longer maintained, and its
successor has another licence. Albumentations receives every value and draws nothing but the noise, from a given seed.
"""

import os
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from math import ceil, cos, floor, radians, sin
from typing import Any, Final

import cv2
import numpy as np
import shapely

from pavetwin.arrays import Float32Array, Float64Array, UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.labels.boxes import FloatBox, PixelBox, flipped
from pavetwin.labels.common_form import AnnotatedImage, Annotation, Polygon
from pavetwin.training.datasets.resizing import CUT, LEAST_SHARE

GONE_SHARE: Final = 0.05
"""Least visible share of an annotation's area; with less it is left out, even if ignored."""

WHOLE_SHARE: Final = 1 - 1e-6
"""From this on nothing but rounding is missing, and an outline keeps all its parts and holes."""

COPY_OF: Final = "copy_of"
"""Attribute of a copy: the name of its image."""

_SLACK_PX: Final = 1e-6  # Tolerance when rounding outwards: a rotated edge on a pixel border stays there


@dataclass(frozen=True, slots=True)
class ImageChange:
    """Difference of a copy from its image."""

    is_flipped: bool = False
    """Left and right exchanged, before the rotation."""
    rotation_deg: float = 0.0
    """Counter-clockwise, as the picture is seen."""
    brightness: float = 0.0
    """Added to all pixels, as a share of the full scale."""
    contrast: float = 0.0
    """Relative change of the distance of each pixel to the picture's mean."""
    noise: float = 0.0
    """Standard deviation of Gaussian noise of each channel, as a share of the full scale."""
    noise_seed: int = 0

    def __str__(self) -> str:
        parts = ["flipped"] if self.is_flipped else []
        if self.rotation_deg:
            parts.append(f"rotated {self.rotation_deg:+.1f}°")
        if self.brightness or self.contrast:
            parts += [f"brightness {self.brightness:+.3f}", f"contrast {self.contrast:+.3f}"]
        if self.noise:
            parts.append(f"noise {self.noise:.3f}")
        return ", ".join(parts)


def shown_window(size_px: tuple[int, int], rotation_deg: float) -> PixelBox:
    """The part of a rotated image that is kept: the largest rectangle about its middle that shows nothing else.

    Args:
        size_px: width, height of the image.
        rotation_deg: within ±45.
    """
    width, height = size_px
    if not rotation_deg:
        return 0, 0, width, height
    across, down = abs(cos(radians(rotation_deg))), abs(sin(radians(rotation_deg)))
    longer, shorter = max(size_px), min(size_px)
    if shorter <= 2 * down * across * longer:
        # Two of its corners touch the longer sides, where these are closest.
        sides = (shorter / (2 * down), shorter / (2 * across))
        wide, high = sides if width >= height else sides[::-1]
    else:
        scale = across**2 - down**2
        wide, high = (width * across - height * down) / scale, (height * across - width * down) / scale
    return _inwards(width, wide), _inwards(height, high), *_ends(size_px, (wide, high))


def _inwards(length: int, shown: float) -> int:
    return min(ceil((length - shown) / 2 - _SLACK_PX), (length - 1) // 2)


def _ends(size_px: tuple[int, int], shown: tuple[float, float]) -> tuple[int, int]:
    return size_px[0] - _inwards(size_px[0], shown[0]), size_px[1] - _inwards(size_px[1], shown[1])


def moved_points(points: Float64Array, size_px: tuple[int, int], change: ImageChange) -> Float64Array:
    """Points (n, 2) of an image after a change: column, row from the corner of the cropped image."""
    width, height = size_px
    moved = points.copy()
    if change.is_flipped:
        moved[:, 0] = width - moved[:, 0]
    if not change.rotation_deg:
        return moved
    angle = radians(change.rotation_deg)
    middle = np.array([width / 2, height / 2])
    x, y = (moved - middle).T
    turned = np.column_stack([cos(angle) * x + sin(angle) * y, cos(angle) * y - sin(angle) * x])
    turned += middle - shown_window(size_px, change.rotation_deg)[:2]
    return turned


def changed(image: AnnotatedImage, change: ImageChange, name: str) -> AnnotatedImage:
    """A copy of an image under a name of its own. It keeps the scene and the ground resolution of the image."""
    left, top, right, bottom = shown_window(image.size_px, change.rotation_deg)
    size_px = (right - left, bottom - top)
    annotations = (_changed(each, image.size_px, size_px, change) for each in image.annotations)
    return replace(
        image,
        name=name,
        suffix=".jpg",
        size_px=size_px,
        annotations=tuple(each for each in annotations if each is not None),
        attributes={**image.attributes, COPY_OF: image.name, "changes": str(change)},
    )


def _changed(
    annotation: Annotation, size_px: tuple[int, int], kept_px: tuple[int, int], change: ImageChange
) -> Annotation | None:
    outline = annotation.outline
    if outline is not None:
        outline = _rounded(moved_points(np.array(outline), size_px, change))
    if not change.rotation_deg:
        box = flipped(annotation.box, size_px[0]) if change.is_flipped else annotation.box
        return replace(annotation, box=box, outline=outline)
    region = _region(annotation, outline, size_px, change)
    shown = shapely.intersection(region, shapely.box(0.0, 0.0, *kept_px))
    share = shapely.area(shown) / shapely.area(region)
    if share < GONE_SHARE:
        return None
    is_cut = share < LEAST_SHARE and annotation.ignored is None
    return replace(
        annotation,
        box=_around(shapely.bounds(shown).tolist(), kept_px),
        outline=_largest(shown) if outline is not None and share < WHOLE_SHARE else outline,
        ignored=CUT if is_cut else annotation.ignored,
    )


def _region(
    annotation: Annotation, outline: Polygon | None, size_px: tuple[int, int], change: ImageChange
) -> shapely.Geometry:
    """Region of an annotation after the change, before cropping: its outline, or its box if that has no area."""
    if outline is not None:
        shape = shapely.make_valid(shapely.Polygon(outline))
        if shapely.area(shape) > 0:
            return shape
    corners = shapely.get_coordinates(shapely.box(*annotation.box))[:-1]
    return shapely.Polygon(moved_points(corners, size_px, change))


def _around(bounds: FloatBox, size_px: tuple[int, int]) -> PixelBox:
    """The smallest box of whole pixels in an image that encloses what has these bounds."""
    left, top = (floor(edge + _SLACK_PX) for edge in bounds[:2])
    right, bottom = (ceil(edge - _SLACK_PX) for edge in bounds[2:])
    left, top = min(max(left, 0), size_px[0] - 1), min(max(top, 0), size_px[1] - 1)
    return left, top, min(max(right, left + 1), size_px[0]), min(max(bottom, top + 1), size_px[1])


def _largest(shown: shapely.Geometry) -> Polygon | None:
    """The corners of the largest part, without its holes."""
    parts = [part for part in shapely.get_parts(shown) if isinstance(part, shapely.Polygon)]
    if not parts:
        return None
    largest = max(parts, key=shapely.area)
    return _rounded(shapely.get_coordinates(largest.exterior)[:-1])


def _rounded(corners: Float64Array) -> Polygon:
    return tuple((round(x, 2), round(y, 2)) for x, y in corners.tolist())


FULL_SCALE: Final = 255.0


@cache
def albumentations() -> Any:
    """The library, which an extra installs.

    Raises:
        PaveTwinError: it is not installed; the message names the command that installs it.
    """
    # It asks for its newest version over the network otherwise.
    os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
    try:
        return import_module("albumentations")
    except ImportError as error:
        raise PaveTwinError(
            "Augmented images need Albumentations, which is not installed; get it with `pip install "
            "'pavetwin[augment]'`."
        ) from error


def changed_picture(picture: UInt8Array, change: ImageChange) -> UInt8Array:
    """The picture (height, width, 3) of a copy: see `pavetwin.training.datasets.augmenting`.

    Raises:
        PaveTwinError: Albumentations is not installed.
    """
    height, width = picture.shape[:2]
    steps: list[Any] = []
    if change.is_flipped:
        steps.append(albumentations().HorizontalFlip(p=1.0))
    if change.rotation_deg:
        left, top, right, bottom = shown_window((width, height), change.rotation_deg)
        angle = change.rotation_deg
        # The border shows only where interpolation reaches over it.
        steps.append(albumentations().Rotate(limit=(angle, angle), border_mode=cv2.BORDER_REFLECT_101, p=1.0))
        steps.append(albumentations().Crop(x_min=left, y_min=top, x_max=right, y_max=bottom, p=1.0))
    if change.brightness or change.contrast:
        # It scales about black; the picture's mean shall stay where it is.
        brightness = change.brightness - change.contrast * float(picture.mean()) / FULL_SCALE
        steps.append(
            albumentations().RandomBrightnessContrast(
                brightness_limit=(brightness, brightness), contrast_limit=(change.contrast, change.contrast), p=1.0
            )
        )
    if change.noise:
        steps.append(albumentations().GaussNoise(std_range=(change.noise, change.noise), p=1.0))
    # Of whole numbers it would cut off the noise towards zero.
    exact = np.divide(picture, FULL_SCALE, dtype=np.float32)
    result: Float32Array = albumentations().Compose(steps, seed=change.noise_seed)(image=exact)["image"]
    return np.rint(result.clip(0.0, 1.0) * FULL_SCALE).astype(np.uint8)
