"""Repeated photographs and photographs of one place, recognised by their content, not by their names.

- Copies: each picture is reduced to a small grey thumbnail without its coarse shading, so that neither a vignette nor
  the sun's side makes pictures alike. Thumbnails are compared by zero-mean normalised correlation, all pairs, block by
  block.
- Overlaps, shifted, cropped, turned or scaled: each picture is described by up to `FEATURES` corners and the brightness
  pattern around each (ORB: Rublee, Rabaud, Konolige and Bradski 2011). Pairs that share some patterns bit by bit are
  candidates (locality-sensitive hashing: Indyk and Motwani 1998). In a candidate pair each corner is matched with the
  most similar one of the other picture; the pictures overlap if enough matches agree on one shift, rotation and scale.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image
from scipy import ndimage

from pavetwin.arrays import Float16Array, Float32Array, Int64Array, UInt8Array
from pavetwin.training.datasets.pictures import PictureError

FEATURES: Final = 300
"""Corners of a picture, at most."""

LONGEST_PX: Final = 512  # Pictures are brought to this size first
CORNER_CONTRAST: Final = 5  # Grey levels by which a corner stands out, of 255: asphalt has little contrast
TABLES: Final = 8  # Hash tables, each of 32 of the 256 bits of a pattern
LEAST_SHARED: Final = 3  # Patterns that candidates share in the tables

COMMONEST: Final = 16
"""Most pictures that share a distinctive pattern; more common ones, such as the end of a line, are ignored."""

DISTINCT: Final = 0.8  # The most similar pattern must be so much more similar than the second (Lowe 2004)
AGREEING: Final = 12  # Matches that must agree. `docs/how-to/real-images.md` states the recall
WITHIN_PX: Final = 3.0  # So near must a match lie to where shift, turn and scale put it

SCALES: Final = (0.4, 2.5)


@dataclass(frozen=True, slots=True)
class Features:
    """Corners of a picture and the brightness pattern around each."""

    places: Float16Array
    """(n, 2) columns and rows in the picture brought to size."""
    patterns: UInt8Array
    """(n, 32): 256 bits each."""


def features(grey: UInt8Array) -> Features:
    """The features of a picture (height, width)."""
    import cv2

    factor = LONGEST_PX / max(grey.shape)
    if factor < 1:
        size = max(1, round(grey.shape[1] * factor)), max(1, round(grey.shape[0] * factor))
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    # One for each picture: it is not documented to be thread-safe.
    detector = cv2.ORB.create(nfeatures=FEATURES, fastThreshold=CORNER_CONTRAST)
    found, patterns = detector.detectAndCompute(grey, None)
    places = np.array([corner.pt for corner in found], dtype=np.float16).reshape(-1, 2)
    return Features(places, np.zeros((0, 32), dtype=np.uint8) if not len(found) else np.asarray(patterns))


def candidates(described: Sequence[Features]) -> Iterator[tuple[int, int]]:
    """Pairs (first < second) of pictures that share patterns, in order."""
    count = len(described)
    owners = np.repeat(np.arange(count), [len(each.patterns) for each in described])
    if not len(owners):
        return
    found = []
    for table in range(TABLES):
        parts = np.concatenate([each.patterns[:, 4 * table : 4 * table + 4] for each in described])
        found.append(_sharing(parts, owners, count))
    pairs, shared = np.unique(np.concatenate(found), return_counts=True)
    for pair in pairs[shared >= LEAST_SHARED].tolist():
        yield divmod(pair, count)


def _sharing(parts: UInt8Array, owners: Int64Array, count: int) -> Int64Array:
    """Pairs of pictures with the same part of a pattern, as first · count + second; a pair once for each such part.

    Args:
        parts: (n, 4) of the patterns.
        owners: (n,) their pictures, ascending.
    """
    keys = np.ascontiguousarray(parts).view(np.uint32).ravel()
    order = np.argsort(keys, kind="stable")
    keys, owners = keys[order], owners[order]
    first = np.ones(len(keys), dtype=np.bool_)
    first[1:] = (keys[1:] != keys[:-1]) | (owners[1:] != owners[:-1])
    keys, owners = keys[first], owners[first]
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    sizes = np.diff(np.append(starts, len(keys)))
    kept = np.repeat((sizes > 1) & (sizes <= COMMONEST), sizes)
    keys, owners = keys[kept], owners[kept]
    pairs = [np.empty(0, dtype=np.int64)]
    for apart in range(1, COMMONEST):
        same = keys[apart:] == keys[:-apart]
        pairs.append(owners[:-apart][same] * count + owners[apart:][same])
    return np.concatenate(pairs)


def agreeing(one: Features, other: Features) -> int:
    """Matches between two pictures that agree on one shift, turn and scale."""
    import cv2

    if min(len(one.patterns), len(other.patterns)) < 2:
        return 0
    nearest = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(one.patterns, other.patterns, k=2)
    matches = [best for best, second in nearest if best.distance < DISTINCT * second.distance]
    if len(matches) < AGREEING:
        return 0
    start = one.places[[match.queryIdx for match in matches]].astype(np.float32)
    end = other.places[[match.trainIdx for match in matches]].astype(np.float32)
    found, agree = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=WITHIN_PX, maxIters=500)
    if found is None:
        return 0
    scale = float(np.hypot(found[0, 0], found[1, 0]))
    return int(np.count_nonzero(agree)) if SCALES[0] < scale < SCALES[1] else 0


def overlap(one: Features, other: Features) -> bool:
    """Return whether two pictures overlap."""
    return agreeing(one, other) >= AGREEING


SIDE_PX: Final = 32  # Side of the thumbnails
SHADING_PX: Final = 4.0  # Standard deviation of the Gaussian that is subtracted, in pixels of the small picture

SAME: Final = 0.995
"""Correlation from which two pictures are one photograph, perhaps compressed again or scaled."""

ALIKE: Final = 0.85
"""Correlation from which two pictures show one place, such as neighbouring frames of a film. Of the 26 pairs above it
among the first 600 pictures of the China drone subset we looked at 15, from the highest down to 0.876: 14 show one
place, one shows two stretches with the same double line."""

FLATTEST: Final = 0.5
"""Standard deviation in grey levels below which a small picture shows nothing that could be compared."""

BLACK: Final = 24.0  # Grey level, of 255, that no pixel of a bar exceeds

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
    """Thumbnail of a grey picture: (SIDE_PX²,) of unit length; zeros if it has too little contrast."""
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
    # The row next to a bar holds some of it.
    first, end = int(lit[0]), int(lit[-1]) + 1
    return slice(first + (first > 0), end - (end < len(brightest)))


@dataclass(frozen=True, slots=True)
class Signature:
    """Features by which two pictures are recognised as the same or as showing one place."""

    sha256: str
    """SHA-256 of the file."""
    thumbnail: Float32Array
    features: Features


def signature(path: Path) -> Signature:
    """The signature of a picture's file.

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
