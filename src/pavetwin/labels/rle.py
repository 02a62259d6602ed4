"""Masks as COCO run lengths in text. Imports no defect classes: training reads masks without Shapely."""

import numpy as np

from pavetwin.arrays import BoolArray, Int64Array

# Compressed run lengths are column-major, runs of 0 and 1 in turn. Each run, from the fourth on as its difference to
# the run two before it, is written in groups of five bits, least significant first, 32 added where more follow, 48
# added to all (cocoapi, `maskApi.c`, `rleToString`).
_MOST_GROUPS = 12
"""Most groups of a run length: 60 bits, so that sums of a few fit in 64."""


def encode(mask: BoolArray) -> str:
    """Compressed run lengths of a mask (height, width)."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    runs = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return "".join(_text(int(run)) for run in np.concatenate([runs[:3], runs[3:] - runs[1:-2]]))


def decode(text: str, size: tuple[int, int]) -> BoolArray:
    """The mask (height, width) of compressed run lengths.

    Raises:
        ValueError: they do not fill the size, one has more than 60 bits, or a letter is not ASCII.
    """
    runs = _runs(text)
    runs[1::2] = np.cumsum(runs[1::2])
    runs[2::2] = np.cumsum(runs[2::2])
    pixels = size[0] * size[1]
    if runs.min(initial=0) < 0 or runs.max(initial=0) > pixels or runs.sum() != pixels:
        raise ValueError(f"run lengths that do not fill a mask of {size[0]} × {size[1]}")
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(size, order="F")


def _text(value: int) -> str:
    bits, rest = value & 31, value >> 5
    # The sign is the last group's fifth bit.
    if rest == (-1 if bits & 16 else 0):
        return chr(48 + bits)
    return chr(48 + bits + 32) + _text(rest)


def _runs(text: str) -> Int64Array:
    """The numbers of a text, from the fourth on still as differences."""
    if not text.isascii():
        raise ValueError("run lengths have a letter that is not ASCII")
    groups = np.frombuffer(text.encode("ascii"), dtype=np.uint8).astype(np.int64) - 48
    ends = np.concatenate([[0], np.flatnonzero(groups & 32 == 0) + 1])
    if np.diff(ends, append=len(groups)).max() > _MOST_GROUPS:
        raise ValueError(f"a run length has more than {5 * _MOST_GROUPS} bits")
    starts, counts = ends[:-1], np.diff(ends)
    if not len(starts):
        return counts
    places = np.arange(ends[-1]) - np.repeat(starts, counts)
    values = np.add.reduceat((groups[: ends[-1]] & 31) << 5 * places, starts)
    # The sign is the last group's fifth bit.
    return np.where(groups[ends[1:] - 1] & 16, values - (1 << 5 * counts), values)
