"""Pasting of cut-outs: the object in the picture, and the labels under and of it.

An object is scaled and rotated, with soft edges, in the light of its new place and with the shadow that falls there.
The visible share of an annotation under pasted objects decides its fate:

1. From `KEPT_SHARE` on it stays, with the box and the outline of its visible part.
2. Below that it is ignored, neither an object nor background.
3. Below `GONE_SHARE` it is left out.
"""

from dataclasses import dataclass, replace
from math import cos, radians, sin, tan
from typing import Final

import cv2
import numpy as np
from scipy import ndimage

from pavetwin.arrays import BoolArray, Float32Array, UInt8Array
from pavetwin.labels import CUT_OUT, outlines
from pavetwin.labels.boxes import of_mask
from pavetwin.labels.classes import CAR, PERSON
from pavetwin.labels.common_form import Annotation, Polygon, filled
from pavetwin.training.datasets.augmenting import GONE_SHARE
from pavetwin.training.datasets.cutouts import CutOut
from pavetwin.training.datasets.road import Standing

KEPT_SHARE: Final = 0.6
"""Visible share of an annotation's area from which it stays a label."""

COVERED: Final = "covered"


def covered(annotation: Annotation, over: BoolArray, size_px: tuple[int, int]) -> Annotation | None:
    """The remainder of an annotation under objects; None if nothing remains.

    Args:
        over: (height, width) the pixels of the objects.
    """
    region = filled(annotation, size_px)
    visible = region & ~over
    if visible.sum() == region.sum():
        return annotation
    share, box = visible.sum() / region.sum(), of_mask(visible)
    if share < GONE_SHARE or box is None:
        return None
    ignored = COVERED if share < KEPT_SHARE and annotation.ignored is None else annotation.ignored
    shape = _outline(visible) if annotation.outline is not None else None
    return replace(annotation, box=box, outline=shape, ignored=ignored)


def pasted(mask: BoolArray, category: str, name: str) -> Annotation:
    """The label of an object that was put into an image.

    Args:
        mask: (height, width) its pixels.
        name: of its cut-out.
    """
    box = of_mask(mask)
    assert box is not None, "an object has pixels"
    return Annotation(category, box, outline=_outline(mask), original="cut out", attributes={CUT_OUT: name})


def _outline(mask: BoolArray) -> Polygon:
    return tuple((x, y) for x, y in outlines.boundary(mask).tolist())


EDGE_PX: Final = 0.8
"""Standard deviation of the edge's softness; a lens and a sensor leave about as much."""

CUT_PX: Final = 1.5  # So far its mask is made smaller, in its own pixels: the outermost hold some of what was around it
STEPS_PX: Final = 1.2  # Standard deviation by which the edge of a mask is smoothed before, in its own pixels
BRIGHTER: Final = (0.6, 1.5)  # Range of the factor that brings an object's brightness to that of its place

BURNT: Final = 0.97
"""Brightest that the brighter twentieth of an object's pixels become: white paint is not to be without shading."""

TINTED: Final = (0.94, 1.07)  # Range of each colour's factor, besides the brightness
HEIGHTS_M: Final = {CAR.name: 1.4, PERSON.name: 1.7}  # That shadows fall from

UMBRA: Final = 0.45
"""Brightness, as pictures store it, of a road in the shadow of the sun, over that next to it; estimated from images."""

CONTACT: Final = 0.72
"""The same of the darkest place next to an object under a bright sky, where no light comes from below it."""

LEAST_ELEVATION_DEG: Final = 12.0


@dataclass(frozen=True, slots=True)
class Sun:
    """The sun over a picture, where it is known."""

    shadow_deg: float
    """Direction of shadows, clockwise from the picture's top."""
    elevation_deg: float
    clouds: float = 0.0
    """Share of the sky, 0 … 1; under 1 nothing casts a sharp shadow."""


@dataclass(frozen=True, slots=True)
class Turned:
    """A cut-out at the scale and angle of a picture."""

    colour: Float32Array
    """(height, width, 3) 0 … 1."""
    opacity: Float32Array
    """(height, width) 0 … 1."""


def turned(cut_out: CutOut, scale: float, angle_deg: float) -> Turned:
    """A cut-out scaled and turned clockwise; its outermost pixels, which hold some of its old place, are cut off."""
    pixels = cut_out.pixels.astype(np.float32) / 255
    mask = pixels[..., 3] > 0.5
    inside = ndimage.distance_transform_edt(mask) - ndimage.distance_transform_edt(~mask)
    # Its steps of whole pixels would show where it is enlarged or turned.
    solid = (ndimage.gaussian_filter(inside, STEPS_PX).astype(np.float32) - CUT_PX + 0.5).clip(0, 1)
    # Colours of the object reach beyond its edge, so that none of its old surroundings shows in the soft one.
    core = ndimage.binary_erosion(mask, iterations=3)
    nearest = ndimage.distance_transform_edt(
        ~(core if core.any() else mask), return_distances=False, return_indices=True
    )
    colour = pixels[..., :3][tuple(nearest)]
    if scale < 1:
        size = tuple(max(1, round(side * scale)) for side in solid.shape[::-1])
        colour, solid = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (colour, solid))
        scale = 1.0
    height, width = solid.shape
    c, s = abs(cos(radians(angle_deg))) * scale, abs(sin(radians(angle_deg))) * scale
    size = (round(width * c + height * s) + 6, round(width * s + height * c) + 6)
    matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), -angle_deg, scale)
    matrix[:, 2] += (size[0] - width) / 2, (size[1] - height) / 2
    opacity = cv2.GaussianBlur(cv2.warpAffine(solid, matrix, size, flags=cv2.INTER_LINEAR), (0, 0), EDGE_PX)
    shown = cv2.warpAffine(colour, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return Turned(np.asarray(shown, dtype=np.float32), np.asarray(opacity, dtype=np.float32))


def blended(
    picture: UInt8Array, turned_object: Turned, standing: Standing, cut_out: CutOut, *, gsd_mm: float, sun: Sun | None
) -> UInt8Array:
    """The picture (height, width, 3) with an object in it.

    Args:
        gsd_mm: of the picture.
    """
    result = picture.astype(np.float32) / 255
    solid = np.zeros(picture.shape[:2], dtype=np.float32)
    solid[standing.window] = turned_object.opacity
    gains = _gains(picture, solid > 0.5, cut_out)
    result *= _shade(solid, 1000 * HEIGHTS_M[cut_out.category] / gsd_mm, sun)[..., None]
    within = turned_object.colour[turned_object.opacity > 0.5] * gains
    if len(within) and (brightest := float(np.quantile(within.max(axis=1), 0.95))) > BURNT:
        gains *= BURNT / brightest
    colour = (turned_object.colour * gains).clip(0, 1)
    opacity = turned_object.opacity[..., None]
    result[standing.window] = opacity * colour + (1 - opacity) * result[standing.window]
    shown: Float32Array = np.rint(result.clip(0, 1) * 255)
    return shown.astype(np.uint8)


def _gains(picture: UInt8Array, mask: BoolArray, cut_out: CutOut) -> Float32Array:
    """(3,) Factors of red, green and blue: what surrounds an object now, over what surrounded it."""
    around = ndimage.binary_dilation(mask, iterations=10) & ~ndimage.binary_dilation(mask, iterations=2)
    here = picture[around].mean(axis=0) if around.any() else np.array(cut_out.surroundings)
    there = np.maximum(cut_out.surroundings, 1.0)
    brighter = np.clip(here.mean() / there.mean(), *BRIGHTER)
    tint = np.clip(here / there / max(here.mean() / there.mean(), 1e-6), *TINTED)
    return np.asarray(brighter * tint, dtype=np.float32)


def _shade(solid: Float32Array, height_px: float, sun: Sun | None) -> Float32Array:
    """(height, width) The factor of the road's brightness: the shadow of the sun, where it is known, and of the sky."""
    size = np.sqrt(float((solid > 0.5).sum()))
    near = ndimage.gaussian_filter(solid, max(1.0, 0.06 * size))
    shade = 1 - (1 - CONTACT) * np.minimum(1.0, 1.6 * near)
    if sun is None or sun.elevation_deg < LEAST_ELEVATION_DEG or sun.clouds >= 1:
        return np.asarray(shade, dtype=np.float32)
    length = height_px / tan(radians(sun.elevation_deg))
    right, down = sin(radians(sun.shadow_deg)) * length, -cos(radians(sun.shadow_deg)) * length
    swept = solid.copy()
    steps = max(2, int(np.ceil(length)))
    for step in np.linspace(0, 1, min(steps, 200))[1:].tolist():
        np.maximum(swept, _moved(solid, round(right * step), round(down * step)), out=swept)
    soft = ndimage.gaussian_filter(swept, 1.0 + 0.01 * length)
    return np.asarray(shade * (1 - (1 - UMBRA) * (1 - sun.clouds) * soft), dtype=np.float32)


def _moved(mask: Float32Array, right: int, down: int) -> Float32Array:
    """A mask moved by whole pixels; what comes in is 0."""
    result = np.zeros_like(mask)
    height, width = mask.shape
    if abs(right) >= width or abs(down) >= height:
        return result
    to = np.s_[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)]
    origin = np.s_[max(-down, 0) : height - max(down, 0), max(-right, 0) : width - max(right, 0)]
    result[to] = mask[origin]
    return result
