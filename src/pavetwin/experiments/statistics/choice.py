"""The choice of an option under limits: the best for an objective, and the probability that it truly is.

The probabilities come from draws of the true means, corrected for the winner's curse: the option with the best mean of
many was chosen for its random errors too, and resampling repeats the same errors. The correction is empirical Bayes on
the parts of an analysis of variance. The options' means are split into their average, the main effects of each factor,
and the rest. The average is kept. Every other part, with squared length q and noise n (the squared length that errors
alone would have), becomes

    part = (1 − κ) · observed part,   κ with the density  κ^(ν/2) · exp(−κ ν q / 2n)  on 0 … 1,

where κ = n / (n + variance of the true effects) has an even prior (Strawderman 1971) and ν is the number of degrees of
freedom of the noise after Satterthwaite. A part no larger than noise shrinks away (κ near 1); a part far larger than
noise hardly changes. Every draw has its own κ and adds √(1 − κ) times the deviation of a resample of the replicates,
which keeps their correlations and skewness, with Student's tails for few of them.

Policies differ in few replicates only: where traffic hides a defect. Options that are level in all replicates would be
level in all draws, although the next replicate may separate them. The noise therefore includes `unseen` replicates that
were not flown (one in Laplace's rule of succession), in which every contrast of the options varies as contrasts of this
study do on average.

docs/explanation/statistics.md shows how well the claims hold (`python -m benchmarks.calibration`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from math import isfinite
from typing import Any, Final

import numpy as np
from scipy.special import gammainc, gammaincinv

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.experiments.metrics import COMPARED, INDEX_ERROR
from pavetwin.experiments.statistics.bootstrap import Sizes, resamples, strata

DRAWS: Final = 4000
_SHRINKAGE: Final = 3  # Separates these draws from those of bootstrap and tests under the same seed
_FLAT: Final = 1e-3  # Below this rate the density of κ is a power of κ to many digits


@dataclass(frozen=True)
class TrueMeans:
    """The options' true means as far as the replicates show them."""

    expected: Float64Array
    """(options,) NaN where there is no value."""
    draws: Float64Array
    """(draws, options) equally likely means."""


def true_means(
    units: Float64Array, worlds: IndexArray, levels: Sequence[IndexArray], seed: int, *, unseen: float = 0.0
) -> TrueMeans:
    """Shrunk means of one metric, and draws of them. Metrics of the same study share resamples under the same seed.

    Args:
        units: (options, blocks) one value per replicate, NaN where undefined.
        worlds: (blocks,) number of each block's world, ascending; differences between worlds are not noise.
        levels: for each factor, (options,) the number of the option's level.
        unseen: number of replicates that were not flown and count besides those that were.
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
    """(options,) observed means and (draws, options) deviations of the means of resamples."""
    counts, here = _counts(strata(worlds), seed), np.isfinite(units)
    values = np.nan_to_num(units)
    observed = values.sum(axis=1) / here.sum(axis=1)
    drawn, sums = counts @ here.T.astype(np.float64), counts @ values.T
    means = np.divide(sums, drawn, out=np.tile(observed, (len(counts), 1)), where=drawn > 0)
    return observed, means - observed


@lru_cache(maxsize=4)
def _counts(sizes: Sizes, seed: int) -> Float64Array:
    """(draws, replicates) number of times that each replicate is drawn, the same for all metrics of a study."""
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
    variances = [(spread * (deviations @ basis)).var(axis=0) for basis in parts[1:]]
    average = float(np.concatenate(variances or [np.zeros(1)]).mean())  # over all contrasts
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


COVERAGE, TIME, ENERGY = COMPARED
ALTITUDE: Final = "altitude_m"
SAME: Final = 1e-9
"""Values closer than this are equal: sums of the same shares in another order."""
UNSEEN: Final = 1.0
"""Replicates that were not flown, in which options that are level may differ in coverage. Costs have none: the time of
a policy that waits is not evidence about one that does not."""
_MORE_IS_BETTER: Final = (COVERAGE, ALTITUDE)
_SENSOR: Final = 4  # Separates draws of a sensor's parameters from others under the same seed
_NEAR: Final = 0.01  # Options that break their limits by this share more than the nearest are as near

Row = dict[str, Any]
"""An option: its levels and the columns of `Recommendation.options`."""


class Objective(StrEnum):
    """The criterion that chooses among the options that keep the limits."""

    MOST_FOUND = "most-found"
    """The best coverage."""
    HIGHEST = "highest"
    """The highest altitude, whatever the policy."""
    FASTEST = "fastest"
    """The least time."""
    LEAST_ENERGY = "least-energy"
    """The least of a battery."""
    MOST_ACCURATE_INDEX = "most-accurate-index"
    """The smallest error of the condition index by what was detected."""

    @classmethod
    def named(cls, name: str) -> "Objective":
        """Raises:
        PaveTwinError: there is no objective of this name.
        """
        if name not in (names := [*map(str, cls)]):
            near = nearest_name(name, names)
            raise PaveTwinError(f"`objective`: no objective '{name}'{near}; known are {', '.join(names)}.")
        return cls(name)

    @property
    def order(self) -> tuple[str, ...]:
        """The metric that decides, then those that decide among options that are level in it. Options at the highest
        altitude are level with each other."""
        return {
            Objective.MOST_FOUND: (COVERAGE, TIME, ENERGY),
            Objective.HIGHEST: (ALTITUDE,),
            Objective.FASTEST: (TIME, COVERAGE, ENERGY),
            Objective.LEAST_ENERGY: (ENERGY, COVERAGE, TIME),
            Objective.MOST_ACCURATE_INDEX: (INDEX_ERROR, COVERAGE, TIME, ENERGY),
        }[self]

    @property
    def judged(self) -> tuple[str, ...]:
        """The metrics that options are judged by: `COMPARED`, and the measured metric that decides."""
        return (*COMPARED, *(name for name in self.order if name not in (*COMPARED, ALTITUDE)))

    @property
    def needs_coverage(self) -> bool:
        """True if an option that finds nothing could win: it is fast, and right about a road without defects."""
        return self is not Objective.MOST_FOUND


@dataclass(frozen=True)
class MissionLimits:
    """Limits on an option's means, per segment mission or per tour. None is no limit."""

    max_time_s: float | None = None
    max_energy: float | None = None
    """Share of a battery."""
    min_coverage: float | None = None
    """Share, 0 … 1."""

    def __post_init__(self) -> None:
        for name, value in (("max_time_s", self.max_time_s), ("max_energy", self.max_energy)):
            if value is not None and not (isfinite(value) and value > 0):
                raise PaveTwinError(f"`{name}`: {value:g} is not a limit; give a positive number.")
        if self.min_coverage is not None and not 0 <= self.min_coverage <= 1:
            raise PaveTwinError(f"`min_coverage`: {self.min_coverage:g} is not a share; give a number from 0 to 1.")

    @property
    def named(self) -> dict[str, float]:
        """The limits that are set, by the metric they hold for."""
        limits = {COVERAGE: self.min_coverage, TIME: self.max_time_s, ENERGY: self.max_energy}
        return {name: limit for name, limit in limits.items() if limit is not None}


@dataclass(frozen=True)
class Chances:
    """Probabilities and expectations of the options' true means, NaN where undefined."""

    kept: Float64Array
    """(options,) probability of keeping the limits."""
    certainty: Float64Array
    """(options,) probability of also being the best, or level with the best, of those that keep the limits."""
    expected: Float64Array
    """(metrics, options) expected true means of the metrics of the objective."""


def choice_under(
    limits: MissionLimits,
    units: Float64Array,
    worlds: IndexArray,
    levels: Sequence[IndexArray],
    seed: int,
    *,
    objective: Objective = Objective.MOST_FOUND,
    altitudes_m: Float64Array | None = None,
    sensor_errors: Float64Array | None = None,
) -> Chances:
    """Probability that each option keeps the limits and is the best, in draws of the true means.

    Options with the same values in every replicate count as one option.

    Args:
        units: (metrics, options, blocks) value of each metric of the objective per replicate, NaN where undefined.
        worlds, levels: as `true_means` takes them.
        altitudes_m: (options,) for the objective `HIGHEST`.
        sensor_errors: (options, parameter draws) change of the mean coverage with other, equally likely parameters of
            the sensor.
    """
    first, of = distinct(np.concatenate([*units], axis=1))
    some = [level[first] for level in levels]
    likely = [
        true_means(values[first], worlds, some, seed, unseen=UNSEEN if name == COVERAGE else 0.0)
        for name, values in zip(objective.judged, units, strict=True)
    ]
    draws = np.stack([each.draws[:, of] for each in likely])
    if sensor_errors is not None:
        drawn = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_SENSOR,)))
        draws[0] += sensor_errors[:, drawn.integers(sensor_errors.shape[1], size=draws.shape[1])].T
    coverage, *costs = (each.expected[of] for each in likely)
    possible = np.stack([np.clip(coverage, 0.0, 1.0), *(np.maximum(cost, 0.0) for cost in costs)])
    kept = keeping(draws, limits)
    return Chances(kept.mean(axis=0), best_among(draws, kept, objective, altitudes_m).mean(axis=0), possible)


def keeping(means: Float64Array, limits: MissionLimits) -> BoolArray:
    """(draws, options) True where (metrics, draws, options) means keep the limits; undefined means keep none."""
    kept = ~np.isnan(means).any(axis=0)
    for name, limit in limits.named.items():
        value = means[COMPARED.index(name)]
        kept &= value >= limit - SAME if name == COVERAGE else value <= limit * (1 + SAME)
    return np.asarray(kept)


def best_among(
    means: Float64Array, kept: BoolArray, objective: Objective, altitudes_m: Float64Array | None = None
) -> BoolArray:
    """(draws, options) True for the best, and those level with it, of the options that are `kept` in a draw.

    Args:
        means: (metrics, draws, options) of the metrics of the objective.
        altitudes_m: (options,) for the objective `HIGHEST`.
    """
    values: Mapping[str, Float64Array | None] = {
        **dict(zip(objective.judged, means, strict=True)),
        ALTITUDE: altitudes_m,
    }
    best = kept.copy()
    for name in objective.order:
        column = values[name]
        assert column is not None, f"{objective} is judged by {name}"
        value = np.where(best, -column if name in _MORE_IS_BETTER else column, np.inf)
        least = value.min(axis=1, keepdims=True)
        best &= value <= least + SAME * np.maximum(np.abs(np.where(np.isfinite(least), least, 0.0)), 1.0)
    return best


def nearest_of(options: Sequence[Row], limits: MissionLimits) -> tuple[Row | None, str | None]:
    """The first of the options that break their limits least, and the metric that it breaks most; None of none.

    Args:
        options: best first.
    """
    breaches = [
        (max((_breach(option[name], limit, name), name) for name, limit in limits.named.items()), option)
        for option in options
        if limits.named
        and not option["failed_alone"]
        and not option["unmeasured"]
        and None not in (option[name] for name in COMPARED)
    ]
    if not breaches:
        return None, None
    least = min(breach for (breach, _), _ in breaches)
    return next((option, name) for (breach, name), option in breaches if breach <= least + _NEAR)


def _breach(value: float, limit: float, name: str) -> float:
    """Breach of a limit as a share of it; negative if the value keeps it."""
    if name == COVERAGE:
        return (limit - value) / limit if limit else -1.0
    return value / limit - 1
