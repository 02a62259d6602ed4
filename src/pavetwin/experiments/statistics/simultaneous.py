"""Tests and intervals of many paired differences at once, the intervals being exactly what the tests leave possible.

All comparisons of a family share their replicates. Two methods give the distribution of the most extreme of them:

- Flipped signs (`sign_flip_p`): flipping the signs of the residuals (differences less their mean) shows how small the
  smallest of all p falls by chance (Westfall and Young, Resampling-Based Multiple Testing, 1993,
  single-step minimum p). Few replicates have few assignments of signs, so that many p are equal; |t| ranks those.
- Resampled replicates (see `bootstrap`): the same for the smallest tail of all their t* (Beran, Balanced simultaneous
  confidence sets, JASA 83, 1988). It covers means of heavy tails.

The first is right for few replicates and symmetric differences, the second where waiting makes them skewed. A
difference is reported where both show it: its corrected p is the larger of theirs, and its interval reaches as far
as either's, so that it excludes 0 exactly where that p is below 0.05. Five pairs or fewer exclude nothing.

How often families of intervals hold their true means in simulations stands in docs/explanation/statistics.md.

Where there is no difference, the false positive rate is that of symmetric differences: the difference of two policies
that do the same is as likely positive as negative, whatever their distribution.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, inf
from typing import Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.experiments.statistics.bootstrap import RESAMPLES, centre, resamples, strata, t_of_resamples

EXACT: Final = 16
"""Up to so many replicates every assignment of signs is tried."""
ASSIGNMENTS: Final = 2**15
"""Tried for more: the one observed, and drawn ones (Phipson and Smyth 2010: p is never 0)."""

_SIGNS: Final = 2  # Keeps these draws apart from those of the bootstrap under the same seed
_ROUNDING: Final = 1e-9  # Sums of decimal fractions that are equal on paper differ in their last bits


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
        """Interval of means that more than `reached` assignments reach, or exactly as many with |t| at most `t`.

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


ALPHA: Final = 0.05
"""Family-wise error: of all reported differences, and of all intervals together."""


class Verdicts(NamedTuple):
    """(comparisons,) each; NaN where fewer than two pairs leave nothing to test."""

    p: Float64Array
    """p of "the mean difference is 0" by flipped signs, two-sided, each comparison by itself."""
    p_corrected: Float64Array
    low: Float64Array
    high: Float64Array
    """Simultaneous 95 % intervals; infinite where so few pairs exclude nothing."""


def simultaneous(units: Float64Array, worlds: IndexArray, seed: int = 0) -> Verdicts:
    """Test all comparisons of a family together.

    Args:
        units: (comparisons, blocks) paired differences, NaN where there is none.
        worlds: (blocks,) number of each block's world, ascending.
    """
    columns = np.full((4, len(units)), np.nan)
    tested = np.flatnonzero((~np.isnan(units)).sum(axis=1) >= 2)
    if len(tested):
        p, flipped, *ends = _by_flips(units[tested], seed)
        resampled, *others = _by_resamples(units[tested], worlds, seed)
        low, high = np.minimum(ends[0], others[0]), np.maximum(ends[1], others[1])
        columns[:, tested] = p, np.maximum(flipped, resampled), low, high
    return Verdicts(*columns)


def _by_flips(units: Float64Array, seed: int) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """(comparisons,) p, corrected p, and limits."""
    assigned = flips(units.shape[1], seed)
    pairs = [Pairs(row, assigned) for row in units]
    chance = _Rarest.of(pairs, len(assigned))
    reached = np.array([pair.reached for pair in pairs])
    corrected = [chance.p(count, pair.t) for count, pair in zip(reached.tolist(), pairs, strict=True)]
    limits = np.array([pair.interval(*chance.limit) for pair in pairs])
    return reached / len(assigned), np.array(corrected), limits[:, 0], limits[:, 1]


@dataclass(frozen=True)
class _Rarest:
    """Rank of each assignment in the comparison in which it is rarest, sorted from the rarest on."""

    reached: IndexArray
    """(assignments,) how many reach it."""
    t: Float64Array
    """(assignments,) |t|: where as many reach it, a larger one is rarer."""

    @classmethod
    def of(cls, pairs: Sequence[Pairs], assignments: int) -> "_Rarest":
        least, t = np.full(assignments, assignments), np.zeros(assignments)
        for pair in pairs:
            reached, own = pair.by_chance()
            rarer = (reached < least) | ((reached == least) & (own > t))
            least, t = np.where(rarer, reached, least), np.where(rarer, own, t)
        order = np.lexsort((-t, least))
        return cls(least[order], t[order])

    def p(self, reached: int, t: float) -> float:
        """The share of the assignments that are as rare as this, the one observed among them."""
        as_rare = (self.reached < reached) | ((self.reached == reached) & (self.t >= t))
        return min(max(int(as_rare.sum()) + 1, reached) / len(self.t), 1.0)

    @property
    def limit(self) -> tuple[int, float]:
        """A p below `ALPHA` is for fewer reaching it than this, or for as many where |t| is larger; 0 where none is."""
        rank = ceil(ALPHA * len(self.t)) - 1
        if rank < 1:
            return 0, inf
        reached = int(self.reached[rank - 1])
        return (reached, float(self.t[rank - 1])) if reached <= rank else (rank + 1, inf)


def _by_resamples(
    units: Float64Array, worlds: IndexArray, seed: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(comparisons,) corrected p and limits. Comparisons of the same blocks share their resamples."""
    defined = ~np.isnan(units)
    masks, number = np.unique(defined, axis=0, return_inverse=True)
    rarest = np.full(RESAMPLES, RESAMPLES)
    parts = []
    for at, mask in enumerate(masks):
        sizes = strata(worlds[mask])
        values = units[np.ix_(number == at, mask)].T
        t, error = t_of_resamples(values, sizes, resamples(sizes, seed, np.flatnonzero(mask).tolist()))
        ranks = t.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
        rarest = np.minimum(rarest, np.minimum(ranks, RESAMPLES - 1 - ranks).min(axis=1) + 1)
        t.sort(axis=0)
        parts.append((number == at, t, centre(values), error))
    chance = np.sort(rarest)
    # The count from which on the corrected p is no longer below the level.
    limit = int(chance[ceil(ALPHA * (RESAMPLES + 1)) - 2])
    columns = np.empty((3, len(units)))
    for which, t, mean, error in parts:
        own = np.divide(mean, error, out=np.where(mean == 0, 0.0, np.copysign(inf, mean)), where=error > 0)
        beyond = np.where(own > 0, (t >= own).sum(axis=0), (t <= own).sum(axis=0))
        beyond[own == 0] = RESAMPLES
        columns[0, which] = (np.searchsorted(chance, beyond, side="right") + 1) / (RESAMPLES + 1)
        columns[1, which] = mean - np.maximum(t[-limit], 0.0) * error
        columns[2, which] = mean - np.minimum(t[limit - 1], 0.0) * error
    return columns[0], columns[1], columns[2]
