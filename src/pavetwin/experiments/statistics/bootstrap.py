"""95 % intervals of means by the studentised bootstrap, for all cells of a study at once.

A resample draws as many replicates, with replacement, as there are (in each world as many as that world has), and gives

    t* = (m* − m) / √((s*² + s² / n) / (1 + 1 / n)),

with m the mean, s its standard error, n the number of replicates, and a star for the resample's own. The interval is
m − t*(97.5 %) · s … m − t*(2.5 %) · s (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 12.5). The
term s² / n is ours: most shares are often 1, and a resample that happens to draw none of those has s* = 0.

Its coverage in simulations, and that of other methods, stands in docs/decisions/0033-own-statistics.md
(`python -m benchmarks.coverage`). No method solves this: five replicates hold little evidence about a tail that they do
not contain, and a cell in which every replicate has the same value has an interval of that one value.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray

RESAMPLES: Final = 9999
LEVEL: Final = 0.95

_TAIL: Final = round((1 - LEVEL) / 2 * (RESAMPLES + 1)) - 1
"""Index of the lower limit among the sorted resamples; that of the upper one counts from the end."""
_COLUMNS: Final = 64  # Cells resampled at a time, to bound memory
_BOOTSTRAP: Final = 1  # Keeps these draws apart from those of the tests under the same seed

Sizes = tuple[int, ...]
"""Replicates in each world that are resampled among themselves."""


def intervals(units: Float64Array, worlds: IndexArray, seed: int) -> tuple[Float64Array, Float64Array]:
    """95 % intervals of the mean over replicates.

    Cells with as many replicates share their resamples, so that an interval does not depend on which others are asked
    for, and mirrored or shifted values have the mirrored or shifted interval.

    Args:
        units: (cells, blocks) one value per replicate, NaN where it has none.
        worlds: (blocks,) number of each block's world, ascending.

    Returns:
        (cells,) lower and (cells,) upper limits; NaN where fewer than two replicates have a value.
    """
    low, high = np.full(len(units), np.nan), np.full(len(units), np.nan)
    defined = ~np.isnan(units)
    alike: dict[Sizes, list[int]] = {}
    for cell, mask in enumerate(defined):
        if mask.sum() >= 2:
            alike.setdefault(strata(worlds[mask]), []).append(cell)
    for sizes, cells in alike.items():
        counts = resamples(sizes, seed)
        for start in range(0, len(cells), _COLUMNS):
            part = cells[start : start + _COLUMNS]
            values = np.stack([units[cell, defined[cell]] for cell in part], axis=1)
            low[part], high[part] = _studentised(values, sizes, counts)
    return low, high


def strata(worlds: IndexArray) -> Sizes:
    """Number of replicates of each world; all are one stratum if any has a single replicate.

    Args:
        worlds: (replicates,) ascending.
    """
    sizes = tuple(int(size) for size in np.unique(worlds, return_counts=True)[1])
    return (len(worlds),) if min(sizes) < 2 else sizes


def resamples(sizes: Sizes, seed: int, of: Sequence[int] = ()) -> Float64Array:
    """(RESAMPLES, replicates) how often each replicate is drawn: in every stratum as often as it has replicates.

    Args:
        of: numbers of the replicates, where others have draws of their own.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_BOOTSTRAP, *sizes, *of)))
    drawn = [rng.multinomial(size, np.full(size, 1 / size), size=RESAMPLES) for size in sizes]
    return np.concatenate(drawn, axis=1).astype(np.float64)


def _studentised(values: Float64Array, sizes: Sizes, counts: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Limits of (replicates, cells) values; `counts` are the resamples of those `sizes`."""
    t, error = t_of_resamples(values, sizes, counts)
    t.partition((_TAIL, RESAMPLES - 1 - _TAIL), axis=0)
    mean = centre(values)
    return mean - np.maximum(t[-1 - _TAIL], 0.0) * error, mean - np.minimum(t[_TAIL], 0.0) * error


def t_of_resamples(values: Float64Array, sizes: Sizes, counts: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(resamples, cells) t* of (replicates, cells) values, 0 where nothing varies, and (cells,) standard errors."""
    n = len(values)
    variance, variances = np.zeros(values.shape[1]), np.zeros((len(counts), values.shape[1]))
    shifts = np.zeros_like(variances)
    for rows in _rows(sizes):
        size = rows.stop - rows.start
        # From the first value, so that equal values differ by exactly nothing.
        part = values[rows] - values[rows.start]
        part -= part.mean(axis=0)
        drawn = counts[:, rows] @ part
        shifts += drawn / n
        share = size / ((size - 1) * n**2)
        variance += share * (part**2).sum(axis=0)
        variances += share * np.maximum(counts[:, rows] @ part**2 - drawn**2 / size, 0.0)
    blended = np.sqrt((variances + variance / n) / (1 + 1 / n))
    return np.divide(shifts, blended, out=np.zeros_like(shifts), where=blended > 0), np.sqrt(variance)


def variance_of_mean(values: Float64Array, sizes: Sizes) -> float:
    """The squared standard error of the mean of (replicates,) values in strata of these sizes."""
    parts = [values[rows] - values[rows].mean() for rows in _rows(sizes)]
    return float(sum(len(part) / (len(part) - 1) * (part**2).sum() for part in parts)) / len(values) ** 2


def _rows(sizes: Sizes) -> list[slice]:
    ends = np.cumsum(sizes).tolist()
    return [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]


def centre(values: Float64Array) -> Float64Array:
    """(cells,) means of (replicates, cells) values; the mean of equal values is that value to the last bit."""
    return np.asarray(values[0] + (values - values[0]).mean(axis=0))


def centres(units: Float64Array) -> Float64Array:
    """(cells,) means of (cells, blocks) values over the blocks that have one; NaN where none has."""
    rows = [row[~np.isnan(row)] for row in units]
    return np.array([centre(row[:, np.newaxis])[0] if len(row) else np.nan for row in rows])
