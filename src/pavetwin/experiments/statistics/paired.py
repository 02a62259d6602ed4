"""Differences between the levels of a factor, compared in pairs: same traffic, defects and segment, another policy."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.experiments.metrics import METRICS, REFERENCE, Metric
from pavetwin.experiments.statistics.bootstrap import centres, intervals
from pavetwin.experiments.statistics.cells import (
    BoolArray,
    FloatArray,
    IntArray,
    Key,
    key_columns,
    layout,
    nullable,
    values_of,
    varied_columns,
)
from pavetwin.experiments.statistics.summary import interleaved

EXACT_PAIRS: Final = 16
"""Up to so many pairs that differ every assignment of signs is tried."""
FLIPS: Final = 2**15 - 1
"""Assignments drawn for more pairs; with the one observed, p is a multiple of 2⁻¹⁵."""

_CHUNK: Final = 4096
_COLUMNS: Final = 64
_SIGNS: Final = 2
"""Keeps these draws apart from those of the intervals under the same seed."""


def differences(
    table: pl.DataFrame,
    by: Sequence[str],
    metrics: Sequence[Metric] = METRICS,
    *,
    factor: str = "policy",
    reference: Any = REFERENCE,
    seed: int = 0,
) -> pl.DataFrame:
    """Level − reference of `factor`, for every other level and every cell of the other columns of `by`.

    A pair agrees in world, replicate and everything else that the design varies; where `by` leaves some of that out, a
    replicate's pairs are averaged first, since they are not independent. A pair that lacks a value on either side,
    undefined or failed, is left out and counted.

    Columns: `*by` (that of the factor holds the level compared), `metric`, `pairs` (replicates with a difference),
    `undefined` (replicates without), `mean`, `low`, `high` (95 % interval, see `bootstrap`), `p` (see `sign_flip_p`),
    `p_corrected` (Holm, over all comparisons of the same metric), `dz` (mean / SD of the differences). Null is what
    fewer than two pairs do not define, and `dz` where all differences are equal. Empty when the reference is not in
    the table.

    Raises:
        ValueError: `by` lacks the factor.
    """
    if factor not in by:
        raise ValueError(f"by: {list(by)} lacks the factor '{factor}' whose levels are compared.")
    pairing = _Pairing(table, by, factor, reference)
    frames = [_of_metric(pairing, metric, seed) for metric in metrics]
    keys = pl.DataFrame(key_columns(table, by, pairing.keys))
    return interleaved([pl.concat([keys, part], how="horizontal") for part in frames])


class _Pairing:
    """Which cells of the whole design are compared, and which cell of `by` each comparison belongs to."""

    def __init__(self, table: pl.DataFrame, by: Sequence[str], factor: str, reference: Any) -> None:
        others = [column for column in varied_columns(table) if column not in by]
        self.table = table
        # `by` comes first, so that its cells keep the order that `summarise` gives them.
        self.cells = layout(table, [*by, *others])
        at = list(by).index(factor)
        number = {key: cell for cell, key in enumerate(self.cells.keys)}
        pairs: list[tuple[int, int]] = []
        for key, cell in number.items():
            partner = number.get((*key[:at], reference, *key[at + 1 :]))
            if partner is not None and key[at] != reference:
                pairs.append((cell, partner))
        self.level = np.array([cell for cell, _ in pairs], dtype=np.intp)
        self.reference = np.array([cell for _, cell in pairs], dtype=np.intp)
        ordered: dict[Key, int] = {}
        self.group = [ordered.setdefault(self.cells.keys[cell][: len(by)], len(ordered)) for cell, _ in pairs]
        self.keys = tuple(ordered)

    def differences(self, values: FloatArray) -> tuple[FloatArray, BoolArray]:
        """(comparisons, blocks) a replicate's mean difference, NaN where it has none; and where it should have one."""
        means, present = self.cells.means(values), self.cells.present()
        gaps = means[self.level] - means[self.reference]
        expected = present[self.level] & present[self.reference]
        shape = (len(self.keys), gaps.shape[1])
        sums, counts, wanted = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.bool_)
        np.add.at(sums, self.group, np.nan_to_num(gaps, nan=0.0))
        np.add.at(counts, self.group, ~np.isnan(gaps))
        np.logical_or.at(wanted, self.group, expected)
        return np.divide(sums, counts, out=np.full(shape, np.nan), where=counts > 0), wanted


def _of_metric(pairing: _Pairing, metric: Metric, seed: int) -> pl.DataFrame:
    units, wanted = pairing.differences(values_of(pairing.table, metric.name))
    defined = ~np.isnan(units)
    low, high = intervals(units, pairing.cells.worlds, seed)
    mean, p = centres(units), sign_flip_p(units, seed)
    return pl.DataFrame(
        {
            "metric": pl.Series([metric.name] * len(units), dtype=pl.String),
            "pairs": pl.Series(defined.sum(axis=1), dtype=pl.Int64),
            "undefined": pl.Series((wanted & ~defined).sum(axis=1), dtype=pl.Int64),
            "mean": nullable(mean),
            "low": nullable(low),
            "high": nullable(high),
            "p": nullable(p),
            "p_corrected": nullable(holm(p)),
            "dz": nullable([_dz(row[here]) for row, here in zip(units, defined, strict=True)]),
        }
    )


def _dz(gaps: FloatArray) -> float:
    """Cohen's d of paired differences; NaN where they do not vary beyond rounding."""
    if len(gaps) < 2:
        return np.nan
    sd = float(gaps.std(ddof=1))
    return float(gaps.mean()) / sd if sd > 1e-12 * np.abs(gaps).max() else np.nan


def sign_flip_p(units: FloatArray, seed: int = 0) -> FloatArray:
    """Two-sided p of "the differences are as likely positive as negative", by the permutation test of their mean.

    The share of all assignments of signs whose mean is at least as far from 0 as the one observed. Differences of 0
    have no sign. Exact up to `EXACT_PAIRS` others; beyond, by `FLIPS` drawn ones and the observed (Phipson and Smyth
    2010: p is never 0).

    Args:
        units: (comparisons, pairs) differences, NaN where there is none.

    Returns:
        (comparisons,) NaN for fewer than two pairs.
    """
    tested = (~np.isnan(units)).sum(axis=1) >= 2
    p = np.where(tested, 1.0, np.nan)
    differ = ~np.isnan(units) & (units != 0)
    number = differ.sum(axis=1)
    for n in np.unique(number[tested & (number > 0)]):
        rows = np.flatnonzero(tested & (number == n))
        for start in range(0, len(rows), _COLUMNS):
            part = rows[start : start + _COLUMNS]
            p[part] = _flip_p(np.stack([units[row, differ[row]] for row in part], axis=1), seed)
    return p


def _flip_p(gaps: FloatArray, seed: int) -> FloatArray:
    """(comparisons,) p of (pairs, comparisons) differences."""
    # Sums of decimal fractions that are equal on paper differ in their last bits.
    observed = np.abs(gaps.sum(axis=0)) - 1e-9 * np.abs(gaps).sum(axis=0)
    tried, reached = 0, np.zeros(gaps.shape[1])
    for signs in _signs(len(gaps), seed):
        tried += len(signs)
        reached += (np.abs(signs @ gaps) >= observed).sum(axis=0)
    return np.asarray(reached / tried if len(gaps) <= EXACT_PAIRS else (reached + 1) / (tried + 1))


def _signs(n: int, seed: int) -> Iterator[FloatArray]:
    """Chunks of (assignments, n) signs. The last is held, since turning all signs around turns only the mean's."""
    if n <= EXACT_PAIRS:
        for start in range(0, 2 ** (n - 1), _CHUNK):
            numbers = np.arange(start, min(start + _CHUNK, 2 ** (n - 1)))
            yield _as_signs(numbers[:, np.newaxis] >> np.arange(n) & 1)
        return
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SIGNS, n)))
    for start in range(0, FLIPS, _CHUNK):
        yield _as_signs(rng.integers(0, 2, size=(min(_CHUNK, FLIPS - start), n)))


def _as_signs(bits: IntArray) -> FloatArray:
    return np.where(bits, -1.0, 1.0)


def holm(p: FloatArray) -> FloatArray:
    """p-values corrected for being the smallest of many (Holm 1979): holds the family-wise error under any dependence.

    Args:
        p: (comparisons,) NaN where there was no test; such are no part of the family.
    """
    corrected = np.full(len(p), np.nan)
    tested = np.flatnonzero(~np.isnan(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    steps = p[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
