"""A picture with what was found in it."""

from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from pavetwin.arrays import UInt8Array
from pavetwin.perception.classes import CLASSES
from pavetwin.perception.results.detected_image import DetectedImage

_OF_CLASSES: Final = dict(
    zip(CLASSES, [(255, 176, 0), (254, 97, 0), (220, 38, 127), (0, 158, 115), (100, 143, 255)], strict=True)
)
"""Colours that are told apart in colour-blindness too (after Wong 2011 and IBM's palette)."""

_FILL: Final = 90
"""Opacity of masks, of 255."""


def annotated(pixels: UInt8Array, image: DetectedImage) -> Image.Image:
    """A picture (rows, columns, 3) with masks, boxes, classes and confidences; the most confident on top."""
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    height = max(11, round(max(picture.size) / 70))
    font, line = ImageFont.load_default(height), max(2, round(max(picture.size) / 400))
    pen = ImageDraw.Draw(picture, "RGBA")
    for thing in reversed(image.things):
        colour = _OF_CLASSES[thing.name]
        if thing.outline and len(thing.outline) > 2:
            pen.polygon([(x + 0.5, y + 0.5) for x, y in thing.outline], fill=(*colour, _FILL))
        pen.rectangle(thing.box, outline=colour, width=line)
    for thing in reversed(image.things):
        _write(pen, f"{thing.name} {thing.confidence:.2f}", thing.box, picture.size, font, _OF_CLASSES[thing.name])
    return picture


def _write(
    pen: ImageDraw.ImageDraw,
    text: str,
    box: tuple[float, float, float, float],
    size: tuple[int, int],
    font: ImageFont.ImageFont | ImageFont.FreeTypeFont,
    colour: tuple[int, int, int],
) -> None:
    """A label above the box, or within it where there is no room, and never beyond the picture's right edge."""
    left, top, right, bottom = pen.textbbox((0, 0), text, font=font)
    width, height = right - left + 4, bottom - top + 4
    x = max(0.0, min(box[0], size[0] - width))
    y = box[1] - height if box[1] >= height else box[1]
    pen.rectangle((x, y, x + width, y + height), fill=colour)
    dark = sum(colour) > 380
    pen.text((x + 2 - left, y + 2 - top), text, font=font, fill=(0, 0, 0) if dark else (255, 255, 255))
