"""The true means of a study's options, as far as its replicates tell, without the winner's curse.

The option with the best mean of many was chosen for its random errors too: its true mean is lower, and resampling alone
repeats the same errors. The correction is empirical Bayes on the parts of an analysis of variance: the options' means
are split into their average, the main effects of each factor, and what remains. The average stays as it is. Of every
other part, with squared length q and noise n (the squared length that errors alone would have),

    part = (1 − κ) · observed part,   κ with the density  κ^(ν/2) · exp(−κ ν q / 2n)  on 0 … 1,

that is: κ = n / (n + variance of the true effects), with an even prior (Strawderman 1971), ν the degrees of freedom of
that part's noise after Satterthwaite. Where a part is no larger than noise, κ is near 1 and it shrinks away; a part far
larger than noise hardly changes. κ is not plugged in: every draw has its own, and adds √(1 − κ) times the deviation of
a resample of the replicates, which keeps their correlations and skewness, with Student's tails for few of them.

Policies differ in few replicates only: where traffic hides a defect. Options that happen to be level in all replicates
would be level in all draws, and what was not seen in ten replicates may well be in the eleventh. So the noise has a
share of replicates that were not flown, `unseen` of them beside the n that were (Laplace's rule of succession has one),
in which every contrast of the options varies as contrasts of this study do on average.

How well the claims hold stands in docs/explanation/statistics.md (`python -m benchmarks.calibration`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.special import gammainc, gammaincinv

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.experiments.statistics.bootstrap import Sizes, resamples, strata

DRAWS: Final = 4000
_SHRINKAGE: Final = 3
"""Keeps these draws apart from those of bootstrap and tests under the same seed."""
_FLAT: Final = 1e-3
"""Below this rate the density of κ is a power of κ to many digits."""


@dataclass(frozen=True)
class TrueMeans:
    """What is known of the options' true means."""

    expected: Float64Array
    """(options,) NaN where there is no value."""
    draws: Float64Array
    """(draws, options) as likely as each other."""


def true_means(
    units: Float64Array, worlds: IndexArray, levels: Sequence[IndexArray], seed: int, *, unseen: float = 0.0
) -> TrueMeans:
    """Shrunk means of one metric, and draws of them. Metrics of the same study share resamples under the same seed.

    Args:
        units: (options, blocks) one value a replicate, NaN where it has none.
        worlds: (blocks,) number of each block's world, ascending; what lies between worlds is no noise.
        levels: for each factor, (options,) the number of the option's level.
        unseen: how many replicates that were not flown count beside those that were.
    """
    expected, draws = np.full(len(units), np.nan), np.full((DRAWS, len(units)), np.nan)
    known = np.flatnonzero(np.isfinite(units).any(axis=1))
    if len(known):
        observed, deviations = _resampled(units[known], worlds, seed)
        parts = _parts([level[known] for level in levels], len(known))
        made = _shrunk(observed, deviations, parts, len(worlds) - len(np.unique(worlds)), unseen, seed)
        expected[known], draws[:, known] = made
    return TrueMeans(expected, draws)


def distinct(units: Float64Array) -> tuple[IndexArray, IndexArray]:
    """The first of each set of options with the same values, in their order, and for each option its set's number.

    Args:
        units: (options, values) NaN where undefined.
    """
    keys = np.round(np.where(np.isfinite(units), units, np.inf), 9)
    _, first, of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[of.ravel()]


def _resampled(units: Float64Array, worlds: IndexArray, seed: int) -> tuple[Float64Array, Float64Array]:
    """(options,) observed means and (draws, options) how far those of resamples lie from them."""
    counts, here = _counts(strata(worlds), seed), np.isfinite(units)
    values = np.nan_to_num(units)
    observed = values.sum(axis=1) / here.sum(axis=1)
    drawn, sums = counts @ here.T.astype(np.float64), counts @ values.T
    means = np.divide(sums, drawn, out=np.tile(observed, (len(counts), 1)), where=drawn > 0)
    return observed, means - observed


@lru_cache(maxsize=4)
def _counts(sizes: Sizes, seed: int) -> Float64Array:
    """(draws, replicates) how often each replicate is drawn: the same for all metrics of a study."""
    return resamples(sizes, seed)[:DRAWS]


def _parts(levels: Sequence[IndexArray], options: int) -> list[Float64Array]:
    """Orthonormal bases, (options, dimensions) each: of the average, of each factor's main effects, of the rest."""
    bases: list[Float64Array] = []
    factors = [(level[:, np.newaxis] == np.unique(level)).astype(np.float64) for level in levels]
    for columns in (np.ones((options, 1)), *factors, np.eye(options)):
        for basis in bases:
            columns = columns - basis @ (basis.T @ columns)
        directions, lengths, _ = np.linalg.svd(columns, full_matrices=False)
        if (lengths > 1e-9).any():
            bases.append(directions[:, lengths > 1e-9])
    return bases


def _shrunk(
    observed: Float64Array,
    deviations: Float64Array,
    parts: Sequence[Float64Array],
    freedom: int,
    unseen: float,
    seed: int,
) -> tuple[Float64Array, Float64Array]:
    """The fields of `TrueMeans`, every part but the first shrunk by draws of its own κ; no noise and no shrinkage
    without degrees of freedom."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SHRINKAGE,)))
    # The variance among resamples of n replicates is short by (n − 1) / n.
    spread = np.sqrt((freedom + 1) / freedom) if freedom else 0.0
    tails = np.sqrt(freedom / rng.chisquare(freedom, len(deviations))) if freedom else np.zeros(len(deviations))
    expected, draws = np.zeros_like(observed), np.zeros_like(deviations)
    average = _per_contrast([spread * (deviations @ basis) for basis in parts[1:]])
    share = unseen / (freedom + 1 + unseen)
    for number, basis in enumerate(parts):
        own, errors = basis.T @ observed, spread * (deviations @ basis)
        uniform = rng.random(len(deviations))
        if number and share:
            errors = np.sqrt(1 - share) * errors + np.sqrt(share * average) * rng.standard_normal(errors.shape)
        kappa = _kappa(own, errors, uniform) if number else np.zeros(len(deviations))
        draws += ((1 - kappa)[:, np.newaxis] * own + (np.sqrt(1 - kappa) * tails)[:, np.newaxis] * errors) @ basis.T
        expected += basis @ ((1 - kappa.mean()) * own)
    return expected, draws


def _per_contrast(errors: Sequence[Float64Array]) -> float:
    """The mean variance of (draws, contrasts) errors over all contrasts; 0 of none."""
    variances = np.concatenate([part.var(axis=0) for part in errors]) if errors else np.zeros(1)
    return float(variances.mean())


def _kappa(own: Float64Array, errors: Float64Array, uniform: Float64Array) -> Float64Array:
    """Draws of the share of a part that is noise, by the inverse of its distribution at `uniform`."""
    covariance = errors.T @ errors / len(errors)
    noise = float(np.trace(covariance))
    if noise <= 0:
        return np.zeros_like(uniform)
    half = noise**2 / float((covariance**2).sum()) / 2
    rate = half * float(own @ own) / noise
    if rate < _FLAT:
        return np.asarray(uniform ** (1 / (half + 1)))
    found = gammaincinv(half + 1, uniform * gammainc(half + 1, rate)) / rate
    return np.asarray(np.clip(found, 0.0, 1.0))
