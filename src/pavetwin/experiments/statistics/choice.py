"""Which options are the best under limits and for an objective, and how likely each of them truly is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import Any, Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.experiments.metrics import COMPARED, INDEX_ERROR
from pavetwin.experiments.statistics.shrinkage import distinct, true_means

COVERAGE, TIME, ENERGY = COMPARED
ALTITUDE: Final = "altitude_m"
SAME: Final = 1e-9
"""Values closer than this are equal: sums of the same shares in another order."""
UNSEEN: Final = 1.0
"""Replicates that were not flown, beside those that were, in which options that are level may differ in coverage. Costs
have none: what a policy that waits takes longer tells nothing of one that does not."""
_MORE_IS_BETTER: Final = (COVERAGE, ALTITUDE)
_SENSOR: Final = 4
"""Keeps draws of a sensor's parameters apart from others under the same seed."""
_NEAR: Final = 0.01
"""Options that break their limits by this share more than the nearest are as near."""

Row = dict[str, Any]
"""An option: its levels and the columns of `Recommendation.options`."""


class Objective(StrEnum):
    """By what the best of the options that keep the limits is chosen."""

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
        """What decides, then what decides among options that are level in that. Of the highest none is better: they are
        level with each other."""
        return {
            Objective.MOST_FOUND: (COVERAGE, TIME, ENERGY),
            Objective.HIGHEST: (ALTITUDE,),
            Objective.FASTEST: (TIME, COVERAGE, ENERGY),
            Objective.LEAST_ENERGY: (ENERGY, COVERAGE, TIME),
            Objective.MOST_ACCURATE_INDEX: (INDEX_ERROR, COVERAGE, TIME, ENERGY),
        }[self]

    @property
    def judged(self) -> tuple[str, ...]:
        """The metrics that options are judged by: `COMPARED`, and what else decides and is measured."""
        return (*COMPARED, *(name for name in self.order if name not in (*COMPARED, ALTITUDE)))

    @property
    def needs_coverage(self) -> bool:
        """Whether an option that finds nothing may be the best of all: soon done, or right about a sound road."""
        return self is not Objective.MOST_FOUND


@dataclass(frozen=True)
class MissionLimits:
    """What an option must keep on average, per segment mission, or per mission where these are tours.
    None: no limit."""

    max_time_s: float | None = None
    max_energy: float | None = None
    """As a share of a battery."""
    min_coverage: float | None = None
    """As a share, 0 … 1."""

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

    @property
    def words(self) -> str:
        return "the limit" if len(self.named) == 1 else "the limits"


@dataclass(frozen=True)
class Chances:
    """What the replicates say of the options' true means, NaN where undefined."""

    kept: Float64Array
    """(options,) the probability that they keep the limits."""
    certainty: Float64Array
    """(options,) that the option also is the best of all that do, or level with the best."""
    expected: Float64Array
    """(metrics, options) true means of what the objective judges by."""


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
    """How likely each option keeps the limits and is the best, in draws of the true means.

    Options with the same values in every replicate are one option: how many others do the same
    changes nothing.

    Args:
        units: (metrics, options, blocks) of each replicate what the objective judges by, NaN where undefined.
        worlds, levels: as `true_means` takes them.
        altitudes_m: (options,) for the objective that asks for them.
        sensor_errors: (options, parameter draws) by how much another sensor, as likely, changes the mean coverage.
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
    """(draws, options) where (metrics, draws, options) means keep the limits; what is undefined keeps none."""
    kept = ~np.isnan(means).any(axis=0)
    for name, limit in limits.named.items():
        value = means[COMPARED.index(name)]
        kept &= value >= limit - SAME if name == COVERAGE else value <= limit * (1 + SAME)
    return np.asarray(kept)


def best_among(
    means: Float64Array, kept: BoolArray, objective: Objective, altitudes_m: Float64Array | None = None
) -> BoolArray:
    """(draws, options) which are the best, or level with the best, of those that are `kept` in a draw.

    Args:
        means: (metrics, draws, options) of what the objective judges by.
        altitudes_m: (options,) for the objective that asks for them.
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
    """By which share of the limit a value breaks it; negative where it keeps it."""
    if name == COVERAGE:
        return (limit - value) / limit if limit else -1.0
    return value / limit - 1
