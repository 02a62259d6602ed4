"""Small PNG files: a map has few colours, so a palette of 256 keeps its appearance at a third of the size."""

from pathlib import Path

import numpy as np
from PIL import Image

from pavetwin.arrays import IndexArray, UInt8Array

_Bytes = UInt8Array

_EXACT = 48
"""Number of the most frequent colours that are kept unchanged: grounds, roofs, inks."""


def shrink(path: Path) -> None:
    """Rewrite a PNG with a palette of 256 colours. The same picture gives the same bytes.

    Raises:
        OSError: it cannot be read or written.
    """
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"), dtype=np.uint32)
    packed = (pixels[..., 0] << 16) | (pixels[..., 1] << 8) | pixels[..., 2]
    colours, index, counts = np.unique(packed, return_inverse=True, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    rgb = np.stack([colours >> 16, (colours >> 8) & 255, colours & 255], axis=1).astype(np.uint8)
    if len(colours) <= 256:
        palette, nearest = rgb, np.arange(len(colours), dtype=np.uint8)
    else:
        palette = _palette(rgb, counts, order)
        nearest = _nearest(rgb, palette)
    small = Image.fromarray(nearest[index].reshape(packed.shape))
    small.putpalette(palette.tobytes())
    small.save(path, format="PNG", optimize=True)


def _palette(rgb: _Bytes, counts: IndexArray, order: IndexArray) -> _Bytes:
    """The most frequent colours, then always the one worst served so far, so that a rare mark keeps its colour."""
    known, weights = rgb.astype(np.int32), np.sqrt(counts)
    chosen = [int(index) for index in order[:_EXACT]]
    error = np.full(len(rgb), np.iinfo(np.int32).max, dtype=np.int32)
    for index in chosen:
        error = np.minimum(error, ((known - known[index]) ** 2).sum(axis=1))
    while len(chosen) < 256:
        chosen.append(int(np.argmax(error * weights)))
        error = np.minimum(error, ((known - known[chosen[-1]]) ** 2).sum(axis=1))
    return rgb[chosen]


def _nearest(rgb: _Bytes, palette: _Bytes) -> _Bytes:
    pixels, known = rgb.astype(np.int32), palette.astype(np.int32)
    chunks = [
        np.argmin(((part[:, None] - known[None]) ** 2).sum(axis=2), axis=1)
        for part in np.array_split(pixels, len(pixels) // 4096 + 1)
    ]
    return np.concatenate(chunks).astype(np.uint8)
