"""Pictures as pixels, orthophotos among them."""

import warnings
from pathlib import Path
from threading import Lock
from typing import BinaryIO, Final

import numpy as np
from PIL import Image, ImageOps

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError

Picture = str | Path | Image.Image | UInt8Array
"""A file, a picture of Pillow's, or pixels (rows, columns, 3) of red, green and blue."""

LARGEST_PX: Final = 500_000_000
"""Of a file."""

_LIMIT = Lock()


def of_any_size(file: str | Path | BinaryIO, kinds: tuple[str, ...] | None = None) -> Image.Image:
    """A picture of any number of pixels, which are not read yet: the caller has a limit of its own.

    Args:
        kinds: which are taken, as Pillow names them; None takes all.

    Raises:
        OSError, ValueError, SyntaxError: it is no picture, as `PIL.Image.open` says.
    """
    # Pillow refuses large pictures, and its limit is one for the whole process.
    with _LIMIT, warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        usual, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(file, formats=kinds)
        finally:
            Image.MAX_IMAGE_PIXELS = usual


def opened(file: str | Path) -> Image.Image:
    """A picture whose pixels are not read yet.

    Raises:
        PaveTwinError: it is no picture, or too large.
    """
    try:
        held = of_any_size(file)
    except (OSError, ValueError, SyntaxError) as error:
        raise PaveTwinError(f"'{file}' cannot be read as an image ({error}).") from error
    width, height = held.size
    if width * height > LARGEST_PX:
        raise PaveTwinError(
            f"'{file}' has {width} × {height} pixels; at most {LARGEST_PX // 10**6} million are read, so cut it up."
        )
    return held


def pixels_of(image: Picture) -> UInt8Array:
    """An image as red, green and blue (rows, columns, 3), turned as its EXIF says.

    Raises:
        PaveTwinError: it cannot be read as an image, or is too large.
    """
    if isinstance(image, np.ndarray):
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
            raise PaveTwinError("An image as an array is uint8 of (rows, columns, 3): red, green, blue.")
        return image
    held = opened(image) if isinstance(image, str | Path) else image
    try:
        return np.asarray(ImageOps.exif_transpose(held).convert("RGB"))
    # Pillow's decoders raise nearly anything for damaged files.
    except Exception as error:
        what = f"'{image}'" if isinstance(image, str | Path) else "The image"
        raise PaveTwinError(f"{what} cannot be read as an image ({error}).") from error
