"""The same photograph more than once: found by what it shows, not by its name.

Every picture becomes a small grey one without its coarse shading, so that neither a vignette nor the sun's side makes
pictures alike; two are compared by zero-mean normalised correlation. All pairs are compared, block by block.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image
from scipy import ndimage

from pavetwin.arrays import Float32Array
from pavetwin.training.datasets.overlaps import LONGEST_PX, Features, features
from pavetwin.training.datasets.pictures import PictureError

SIDE_PX: Final = 32
"""Of the small pictures."""

SHADING_PX: Final = 4.0
"""Standard deviation of the Gaussian that is subtracted, in pixels of the small picture."""

SAME: Final = 0.995
"""Correlation from which two pictures are one photograph, perhaps compressed again or scaled."""

ALIKE: Final = 0.85
"""Correlation from which two pictures show one place, such as neighbouring frames of a film. Of the 26 pairs above it
among the first 600 pictures of the China drone subset we looked at 15, from the highest down to 0.876: 14 show one
place, one shows two stretches with the same double line."""

FLATTEST: Final = 0.5
"""Standard deviation in grey levels below which a small picture shows nothing that could be compared."""

BLACK: Final = 24.0
"""Grey level, of 255, that no pixel of a bar exceeds."""

BLOCK: Final = 1024


def read_grey(content: bytes) -> Image.Image:
    """A picture's file in grey.

    Raises:
        PictureError: it is damaged.
    """
    try:
        with Image.open(BytesIO(content), formats=("JPEG", "PNG")) as picture:
            picture.draft("L", (LONGEST_PX, LONGEST_PX))
            return picture.convert("L")
    except (OSError, SyntaxError) as error:
        raise PictureError("the picture is damaged") from error


def thumbnail(picture: Image.Image) -> Float32Array:
    """What is compared of a grey picture: (SIDE_PX²,), of length 1; zeros where it shows too little."""
    small = picture.resize((SIDE_PX, SIDE_PX), Image.Resampling.BOX)
    whole = np.zeros((SIDE_PX, SIDE_PX), dtype=np.float32)
    grey = np.asarray(small, dtype=np.float32)
    rows, columns = _shown(grey.max(axis=1)), _shown(grey.max(axis=0))
    part = grey[rows, columns]
    fine = part - ndimage.gaussian_filter(part, SHADING_PX, mode="nearest")
    if part.size and fine.std() >= FLATTEST:
        whole[rows, columns] = fine - fine.mean()
        whole /= np.linalg.norm(whole)
    return whole.ravel()


def _shown(brightest: Float32Array) -> slice:
    """The rows or columns between black bars, with which some pictures are filled up to a square."""
    lit = np.flatnonzero(brightest > BLACK)
    if not len(lit):
        return slice(0, 0)
    # A row beside a bar holds some of it.
    first, end = int(lit[0]), int(lit[-1]) + 1
    return slice(first + (first > 0), end - (end < len(brightest)))


@dataclass(frozen=True, slots=True)
class Signature:
    """What says whether two pictures are the same, or show one place."""

    sha256: str
    """Of the file."""
    thumbnail: Float32Array
    features: Features


def signature(path: Path) -> Signature:
    """Of a picture's file.

    Raises:
        PictureError: it is damaged or missing.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise PictureError("the picture cannot be read") from error
    grey = read_grey(content)
    return Signature(sha256(content).hexdigest(), thumbnail(grey), features(np.asarray(grey)))


def alike(thumbnails: Float32Array, threshold: float = ALIKE) -> Iterator[tuple[int, int, float]]:
    """All pairs (first < second) of rows that correlate by at least `threshold`, and their correlation.

    Args:
        thumbnails: (n, SIDE_PX²)
    """
    for start in range(0, len(thumbnails), BLOCK):
        products = thumbnails[start:] @ thumbnails[start : start + BLOCK].T
        seconds, firsts = np.nonzero(products >= threshold)
        for second, first in sorted(zip(seconds.tolist(), firsts.tolist(), strict=True)):
            if first < second:
                yield start + first, start + second, float(products[second, first])
