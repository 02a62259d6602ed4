"""Sign-flip tests of paired differences: the p of every hypothetical mean, in closed form.

"The mean difference is θ" has as its p the share of all assignments of signs under which |Σ ±(d − θ)| reaches
|Σ (d − θ)|. It does so just where θ lies between the mean of the differences whose sign is flipped and the mean of the
others, so that two sorted lists of such means hold p for every θ.
"""

from math import inf
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray

EXACT: Final = 16
"""Up to so many replicates every assignment of signs is tried."""
ASSIGNMENTS: Final = 2**15
"""Tried for more: the one observed, and drawn ones (Phipson and Smyth 2010: p is never 0)."""

_SIGNS: Final = 2
"""Keeps these draws apart from those of the bootstrap under the same seed."""
_ROUNDING: Final = 1e-9
"""Sums of decimal fractions that are equal on paper differ in their last bits."""


def flips(blocks: int, seed: int) -> Float64Array:
    """(assignments, blocks) 1 where a sign is flipped. The first flips none; where all are tried, the last block's
    sign is fixed, since flipping all signs flips only the mean's.
    """
    if blocks <= EXACT:
        numbers = np.arange(2 ** max(blocks - 1, 0))
        return (numbers[:, np.newaxis] >> np.arange(blocks) & 1).astype(np.float64)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SIGNS, blocks)))
    drawn = rng.integers(0, 2, size=(ASSIGNMENTS, blocks)).astype(np.float64)
    drawn[0] = 0.0
    return drawn


def sign_flip_p(units: Float64Array, seed: int = 0) -> Float64Array:
    """Two-sided p of "the differences are as likely positive as negative", by the permutation test of their mean.

    Args:
        units: (comparisons, blocks) differences, NaN where there is none.

    Returns:
        (comparisons,) NaN for fewer than two pairs.
    """
    assigned = flips(units.shape[1], seed)
    pairs = [Pairs(row, assigned) if np.count_nonzero(~np.isnan(row)) >= 2 else None for row in units]
    return np.array([np.nan if pair is None else pair.reached / len(assigned) for pair in pairs])


class Pairs:
    """The differences of one comparison, at least two, under all assignments of signs."""

    def __init__(self, row: Float64Array, assigned: Float64Array) -> None:
        """`row`: (blocks,) NaN where there is no pair; `assigned`: (assignments, blocks) as `flips` gives them."""
        self._here, self._assigned = ~np.isnan(row), assigned
        known = row[self._here]
        self._n = len(known)
        self._mean = float(known[0] + (known - known[0]).mean())
        self._rounding = _ROUNDING * float(np.abs(known).max())
        self._gaps = np.where(self._here, row, 0.0)
        rest = np.where(self._here, row - self._mean, 0.0)
        # What rounding leaves of equal differences is not a variance.
        self._rest = np.where(np.abs(rest) > self._rounding, rest, 0.0)
        self._error = float(np.sqrt((self._rest**2).sum() / (self._n * (self._n - 1))))

    @property
    def reached(self) -> int:
        """The assignments whose mean is at least as far from 0 as the one observed."""
        sums = self._sums(self._gaps)
        return int((sums >= sums[0] - self._n * self._rounding).sum())

    @property
    def t(self) -> float:
        """|t| of the mean against 0."""
        if abs(self._mean) <= self._rounding:
            return 0.0
        return abs(self._mean) / self._error if self._error else inf

    def by_chance(self) -> tuple[IndexArray, Float64Array]:
        """(assignments,) how many reach what each of them makes of the differences less their mean, and its |t|."""
        sums, squares = self._sums(self._rest), float((self._rest**2).sum())
        if not squares:
            return np.full(len(sums), len(sums)), np.zeros(len(sums))
        order = np.argsort(sums)
        ordered = sums[order]
        reached = np.empty(len(sums), dtype=np.intp)
        reached[order] = len(sums) - np.searchsorted(ordered, ordered - self._n * self._rounding)
        share = sums**2 / (self._n * squares)
        left = np.where(share < 1 - _ROUNDING, 1 - share, 0.0)
        return reached, np.sqrt(np.divide((self._n - 1) * share, left, out=np.full(len(sums), inf), where=left > 0))

    def interval(self, reached: int, t: float) -> tuple[float, float]:
        """The means that more than `reached` assignments reach, or just as many while their |t| is at most `t`.

        Infinite for none.
        """
        if not reached:
            return -inf, inf
        ends, reach = self._ends(), t * self._error if self._error else 0.0
        low, high = (
            float(np.clip(centre - reach, *np.partition(side, (reached - 1, reached))[reached - 1 : reached + 1]))
            for centre, side in ((self._mean, np.minimum(*ends)), (-self._mean, -np.maximum(*ends)))
        )
        return self._snapped(low), -self._snapped(high)

    def _sums(self, gaps: Float64Array) -> Float64Array:
        return np.asarray(np.abs(gaps.sum() - 2 * (self._assigned @ gaps)))

    def _ends(self) -> tuple[Float64Array, Float64Array]:
        """(assignments,) means of the flipped differences and of the others; −∞ and ∞ where either is none."""
        number, sums = self._assigned @ self._here.astype(np.float64), self._assigned @ self._gaps
        both = (number > 0) & (number < self._n)
        turned = np.divide(sums, number, out=np.full(len(sums), -inf), where=both)
        others = np.divide(self._gaps.sum() - sums, self._n - number, out=np.full(len(sums), inf), where=both)
        return turned, others

    def _snapped(self, end: float) -> float:
        return 0.0 if abs(end) <= self._n * self._rounding else end
