"""How wide cracks are in photographs, from how much darker they make the pixels.

In each row across a crack the darkness beside its line, relative to the pavement around it, is summed: a crack that is
a third of a pixel wide darkens that pixel by a third of what it would if it filled it. Its line is the darkest path
through its box. The darkest path through pavement beside the box is dark too, for the stones in it, and is subtracted.
"""

from functools import cache
from typing import Final

import numpy as np
import polars as pl
from PIL import Image
from scipy.ndimage import gaussian_filter

from benchmarks.damage.sources import Photographs
from pavetwin.arrays import Float64Array

DARKNESS: Final = 0.65
"""How much less light the inside of a crack reflects than the pavement: our assumption. Half as much of it would mean
cracks twice as wide."""
AROUND_PX: Final = 10.0
BESIDE_PX: Final = 2
LEAST_PX: Final = (30, 6)
"""Length and width of the boxes that are measured."""
WIDEST: Final = 0.98
"""Where a crack is widest: 2 % of its length are wider, as in ASTM D6433's rule here."""


@cache
def crack_widths(seen: Photographs, pixel_m: float, most: int = 300) -> Float64Array:
    """(cracks,) their width where they are widest [m]; negative where the pavement beside is as dark.

    Args:
        pixel_m: what a pixel covers where no photograph's ground resolution is known.
    """
    cracks = seen.measured.filter(pl.col("kind") == "single_crack")
    found: list[float] = []
    for key, own in cracks.gather_every(max(1, cracks.height // most)).group_by("image", maintain_order=True):
        with Image.open(str(key[0])) as image:
            grey = np.asarray(image.convert("L"), dtype=np.float64) + 1.0
        dark = 1 - grey / gaussian_filter(grey, AROUND_PX)
        for row in own.iter_rows(named=True):
            corners = [round(row[name]) for name in ("xmin", "ymin", "xmax", "ymax")]
            width = _width(dark, *corners)
            found += [] if width is None else [width * (row["pixel_m"] or pixel_m)]
    return np.array(found)


def _width(dark: Float64Array, left: int, top: int, right: int, bottom: int) -> float | None:
    """Of one crack; None where its box is small, or no pavement beside it is in the picture."""
    if right - left > bottom - top:
        return _width(dark.T, top, left, bottom, right)
    across = right - left
    if bottom - top < LEAST_PX[0] or across < LEAST_PX[1]:
        return None
    beside = [left + move for move in (-across - 12, across + 12)]
    plain = [_darkest(dark[top:bottom, at : at + across]) for at in beside if 0 <= at <= dark.shape[1] - across]
    return (_darkest(dark[top:bottom, left:right]) - min(plain)) / DARKNESS if plain else None


def _darkest(dark: Float64Array) -> float:
    """What the rows of the darkest path from the top to the bottom sum to, where it is darkest."""
    rows, columns = dark.shape
    summed, came = dark.copy(), np.zeros((rows, columns), dtype=np.int64)
    for row in range(1, rows):
        above = np.pad(summed[row - 1], 1, constant_values=-np.inf)
        steps = np.stack([above[:-2], above[1:-1], above[2:]])
        came[row] = steps.argmax(axis=0) - 1
        summed[row] += steps.max(axis=0)
    at, sums = int(summed[-1].argmax()), []
    for row in range(rows - 1, -1, -1):
        sums.append(dark[row, max(0, at - BESIDE_PX) : at + BESIDE_PX + 1].sum())
        at += int(came[row, at])
    return float(np.quantile(sums, WIDEST))
