"""Images side by side, with captions in the maps' typeface."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gallery.renderer import Picture
from pavetwin.draw.style import INK, PAPER
from pavetwin.files import writing

GAP_PX: Final = 10
BAND_PX: Final = 30
LARGEST_BYTES: Final = 500_000
WIDTH_PX: Final = 1300


def captioned(picture: Picture, text: str, *, height_px: int) -> Picture:
    """A image, brought to a height, with a line of text below it."""
    image = Image.fromarray(picture)
    if image.height != height_px:
        size = round(image.width * height_px / image.height), height_px
        image = image.resize(size, Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (image.width, height_px + BAND_PX), PAPER)
    whole.paste(image, (0, 0))
    ImageDraw.Draw(whole).text((2, height_px + 6), text, fill=INK, font=ImageFont.load_default(14))
    return np.asarray(whole)


def grid(pictures: Sequence[Picture], *, columns: int) -> Picture:
    """Images in rows."""
    images = [Image.fromarray(picture) for picture in pictures]
    rows = [images[start : start + columns] for start in range(0, len(images), columns)]
    width = max(sum(image.width for image in row) + GAP_PX * (len(row) - 1) for row in rows)
    height = sum(max(image.height for image in row) for row in rows) + GAP_PX * (len(rows) - 1)
    whole = Image.new("RGB", (width, height), PAPER)
    top = 0
    for row in rows:
        left = 0
        for image in row:
            whole.paste(image, (left, top))
            left += image.width + GAP_PX
        top += max(image.height for image in row) + GAP_PX
    return np.asarray(whole)


def save(picture: Picture, path: Path) -> int:
    """Write a JPEG for a web page, as good as fits into `LARGEST_BYTES`. Returns its size in bytes."""
    image = Image.fromarray(picture)
    if image.width > WIDTH_PX:
        image = image.resize((WIDTH_PX, round(image.height * WIDTH_PX / image.width)), Image.Resampling.LANCZOS)
    for quality in range(90, 40, -5):
        with writing(path) as temporary:
            image.save(temporary, format="JPEG", quality=quality, optimize=True)
        if path.stat().st_size <= LARGEST_BYTES:
            break
    return path.stat().st_size
