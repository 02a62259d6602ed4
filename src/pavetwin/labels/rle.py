"""Masks as COCO's compressed run lengths: column-major order, runs of 0 and 1 in turn.

The text is what `pycocotools` reads and writes: each run, from the fourth on as its difference to the run two before
it, in groups of five bits, least significant first, 32 added where more follow, 48 added to all (cocoapi, `maskApi.c`,
`rleToString`).
"""

import numpy as np

from pavetwin.arrays import BoolArray

_MOST_BITS = 65
"""Of a run length, in groups of five: with more, each further group would cost as much as all before it."""


def encode(mask: BoolArray) -> str:
    """The run lengths of a mask (height, width)."""
    flat = np.concatenate([[False], mask.ravel(order="F")])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    runs = np.diff(np.concatenate([[0], changes, [mask.size]]))
    return "".join(_text(int(run)) for run in np.concatenate([runs[:3], runs[3:] - runs[1:-2]]))


def decode(text: str, size: tuple[int, int]) -> BoolArray:
    """The mask (height, width) of run lengths.

    Raises:
        ValueError: they do not fill the size, or one has more than 64 bits.
    """
    runs = _runs(text)
    for index in range(3, len(runs)):
        runs[index] += runs[index - 2]
    if sum(runs) != size[0] * size[1] or min(runs, default=0) < 0:
        raise ValueError(f"run lengths of {sum(runs)} pixels for a mask of {size[0]} × {size[1]}")
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(size, order="F")


def _text(value: int) -> str:
    bits, rest = value & 31, value >> 5
    # The sign is the last group's fifth bit.
    if rest == (-1 if bits & 16 else 0):
        return chr(48 + bits)
    return chr(48 + bits + 32) + _text(rest)


def _runs(text: str) -> list[int]:
    runs, value, shift = [], 0, 0
    for letter in text:
        bits = ord(letter) - 48
        value |= (bits & 31) << shift
        shift += 5
        if shift > _MOST_BITS:
            raise ValueError("a run length has more than 64 bits")
        if not bits & 32:
            runs.append(value - (1 << shift) if bits & 16 else value)
            value = shift = 0
    return runs
