"""Which option to fly under limits of time, battery and coverage, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, isfinite
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import BATTERIES, ERROR_METRICS, TOUR_METRICS, metric_named, metrics_in
from pavetwin.experiments.statistics.cells import (
    failed_alone,
    layout,
    levels_of,
    nullable,
    values_of,
    varied_columns,
)
from pavetwin.experiments.statistics.flips import sign_flip_p
from pavetwin.experiments.statistics.shrinkage import distinct, true_means
from pavetwin.experiments.statistics.summary import FEW, summarise
from pavetwin.experiments.tours import SEGMENTS, is_by_mission
from pavetwin.experiments.words import (
    amount,
    counted,
    factor_name,
    level_name,
    listed,
    opened,
    percent,
    probability,
    setting,
    span,
)

_COVERAGE, _TIME, _ENERGY = _MEASURED = ("coverage", "time_s", "energy")
_SHOWN: Final = 0.05
"""Below this p a difference counts as shown."""
_SAME: Final = 1e-9
"""Coverages closer than this are equal: sums of the same shares in another order."""
UNSEEN: Final = 1.0
"""Replicates that were not flown, beside those that were, in which options that are level may differ in coverage. Costs
have none: what a policy that waits takes longer tells nothing of one that does not."""
FEW_DEFECTS: Final = 100
"""Fewer leave an interval of a coverage of 85 % wider than 15 percentage points, even where they are independent."""
_NEAR: Final = 0.01
"""Options that break their limits by this share more than the nearest are as near."""

Row = dict[str, Any]


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
        limits = {_COVERAGE: self.min_coverage, _TIME: self.max_time_s, _ENERGY: self.max_energy}
        return {name: limit for name, limit in limits.items() if limit is not None}

    @property
    def words(self) -> str:
        return "the limit" if len(self.named) == 1 else "the limits"


@dataclass(frozen=True)
class Recommendation:
    """Every option under the limits, and the best of them."""

    limits: MissionLimits
    by: tuple[str, ...]
    options: pl.DataFrame
    """Best first, then those that break a limit, then those that failed alone. Columns: `*by`, `n` (missions with a
    coverage), `undefined`, `failed`, `defects` (that the coverage rests on, null where the table has none); of
    coverage, time_s and energy each the mean, `…_low`, `…_high` (95 % interval) and `…_expected` (the mean corrected
    for the choice among many, see `true_means`); `time_s_p95`; the means of
    `ERROR_METRICS` where a sensor made such errors; of tours `batteries` (mean) and `batteries_p95`;
    `failed_alone` (missions that failed and that another option flew:
    its means leave out what it failed on); `replicates` (with a coverage); `feasible` (it failed in none alone and its
    means keep the limits), `kept` (the probability that its true means do) and `certainty` (that it also is the best of
    all that do, or level with the best: these may add up to more than 1), as `…_expected` null where there are fewer
    than five replicates; `p` (of its coverage against that of the first); `same` (as the first in coverage, time and
    energy of every replicate)."""
    best: Row | None
    """The first row of `options`; None when no option is feasible."""
    nearest: Row | None
    """When none is feasible: of the options whose worst breach, as a share of the limit, is at most 1 % above the
    smallest, the one with the best coverage."""
    broken: str | None
    """The metric of that worst breach."""
    sentences: tuple[str, ...]


def recommend(
    table: pl.DataFrame, limits: MissionLimits, by: Sequence[str] = ("altitude_m", "policy"), *, seed: int = 0
) -> Recommendation:
    """The option with the best mean coverage of all whose mean time, energy and coverage keep the limits.

    Equal coverages are told apart by time, then by energy. An option that failed in a mission which another flew is not
    recommended: the two means are over different missions. How sure: the choice is made again in each draw of the true
    means (`true_means`: shrunk, so that the best of many is not believed for its random errors); `certainty` is the
    share of draws in which the option is the best or level with the best, so that it does not depend on how many others
    do the same.
    """
    errors = [metric for metric in metrics_in(table) if metric in (*TOUR_METRICS, *ERROR_METRICS)]
    summary = summarise(table, by, [*map(metric_named, _MEASURED), *errors], seed=seed)
    cells = layout(table, by)
    units = np.stack([cells.means(values_of(table, name)) for name in _MEASURED])
    means = np.stack([summary.filter(metric=name)["mean"].fill_null(float("nan")).to_numpy() for name in _MEASURED])
    alone = np.bincount(cells.cell[failed_alone(table, by)], minlength=len(cells.keys))
    units[:, alone > 0] = means[:, alone > 0] = np.nan
    replicates = np.isfinite(cells.means(values_of(table, _COVERAGE))).sum(axis=1)
    levels = [np.unique([str(key[at]) for key in cells.keys], return_inverse=True)[1] for at in range(len(by))]
    chances = choice_under(limits, units, cells.worlds, levels, seed)
    if replicates.max() < FEW:
        chances = Chances(*(np.full(shape, np.nan) for shape in (len(alone), len(alone), units.shape[:2])))
    options = _options(summary, by).with_columns(
        failed_alone=alone,
        replicates=replicates,
        feasible=_feasible(means[:, np.newaxis], limits)[0],
        kept=nullable(chances.kept),
        certainty=nullable(chances.certainty),
        **{f"{name}_expected": nullable(row) for name, row in zip(_MEASURED, chances.expected, strict=True)},
    )
    order = ["feasible", pl.col("failed_alone") > 0, _COVERAGE, _TIME, _ENERGY]
    options = options.with_row_index("at").sort(
        order, descending=[True, False, True, False, False], nulls_last=True, maintain_order=True
    )
    units = units[:, options["at"].to_numpy()]
    options = options.drop("at").with_columns(
        p=nullable(sign_flip_p(units[0, :1] - units[0], seed)),
        same=np.asarray(np.isclose(units, units[:, :1], rtol=_SAME, atol=_SAME, equal_nan=True).all(axis=(0, 2))),
    )
    best = options.row(0, named=True) if options["feasible"].any() else None
    nearest, broken = (None, None) if best else _nearest(options, limits)
    rows = options.to_dicts()
    sentences = _sentences(table, rows, by, limits) if best else _refusal(rows, by, nearest, broken, limits)
    return Recommendation(limits, tuple(by), options, best, nearest, broken, tuple(map(opened, sentences)))


def _options(summary: pl.DataFrame, by: Sequence[str]) -> pl.DataFrame:
    parts = {name: summary.filter(metric=name) for name in _MEASURED}
    frame = parts[_COVERAGE].select(*by, "n", "undefined", "failed", "defects")
    for name, part in parts.items():
        frame = frame.with_columns(
            part["mean"].alias(name), part["low"].alias(f"{name}_low"), part["high"].alias(f"{name}_high")
        )
    others = {metric.name: summary.filter(metric=metric.name) for metric in (*TOUR_METRICS, *ERROR_METRICS)}
    shown = [part["mean"].alias(name) for name, part in others.items() if part.height]
    shown += [part["p95"].alias(f"{BATTERIES}_p95") for part in [others[BATTERIES]] if part.height]
    return frame.with_columns(parts[_TIME]["p95"].alias("time_s_p95"), *shown)


@dataclass(frozen=True)
class Chances:
    """What the replicates say of the options' true means, NaN where undefined."""

    kept: Float64Array
    """(options,) the probability that they keep the limits."""
    certainty: Float64Array
    """(options,) that the option also is the best of all that do, or level with the best."""
    expected: Float64Array
    """(3, options) true means of coverage, time and energy."""


def choice_under(
    limits: MissionLimits, units: Float64Array, worlds: IndexArray, levels: Sequence[IndexArray], seed: int
) -> Chances:
    """How likely each option keeps the limits and is the best, in draws of the true means.

    Options with the same coverage, time and energy in every replicate are one option: how many others do the same
    changes nothing.

    Args:
        units: (3, options, blocks) coverage, time and energy of each replicate, NaN where undefined.
        worlds, levels: as `true_means` takes them.
    """
    first, of = distinct(np.concatenate([*units], axis=1))
    some = [level[first] for level in levels]
    likely = [
        true_means(values[first], worlds, some, seed, unseen=UNSEEN if name == _COVERAGE else 0.0)
        for name, values in zip(_MEASURED, units, strict=True)
    ]
    draws = np.stack([each.draws[:, of] for each in likely])
    coverage, *costs = (each.expected[of] for each in likely)
    possible = np.stack([np.clip(coverage, 0.0, 1.0), *(np.maximum(cost, 0.0) for cost in costs)])
    feasible = _feasible(draws, limits)
    chosen = feasible.copy()
    for name, sign in ((_COVERAGE, -1.0), (_TIME, 1.0), (_ENERGY, 1.0)):
        value = np.where(chosen, sign * draws[_MEASURED.index(name)], np.inf)
        least = value.min(axis=1, keepdims=True)
        chosen &= value <= least + _SAME * np.maximum(np.abs(np.where(np.isfinite(least), least, 0.0)), 1.0)
    return Chances(feasible.mean(axis=0), chosen.mean(axis=0), possible)


def _feasible(means: Float64Array, limits: MissionLimits) -> BoolArray:
    """(resamples, options) of (3, resamples, options) means; what is undefined keeps no limit."""
    kept = ~np.isnan(means).any(axis=0)
    for name, limit in limits.named.items():
        value = means[_MEASURED.index(name)]
        kept &= value >= limit - _SAME if name == _COVERAGE else value <= limit * (1 + _SAME)
    return np.asarray(kept)


def _nearest(options: pl.DataFrame, limits: MissionLimits) -> tuple[Row | None, str | None]:
    breaches = [
        (max((_breach(option[name], limit, name), name) for name, limit in limits.named.items()), option)
        for option in options.iter_rows(named=True)
        if limits.named and not option["failed_alone"] and None not in (option[name] for name in _MEASURED)
    ]
    if not breaches:
        return None, None
    least = min(breach for (breach, _), _ in breaches)
    # The options stand in the order of their coverage.
    return next((option, name) for (breach, name), option in breaches if breach <= least + _NEAR)


def _breach(value: float, limit: float, name: str) -> float:
    """By which share of the limit a value breaks it; negative where it keeps it."""
    if name == _COVERAGE:
        return (limit - value) / limit if limit else -1.0
    return value / limit - 1


def _sentences(table: pl.DataFrame, options: Sequence[Row], by: Sequence[str], limits: MissionLimits) -> list[str]:
    best, *others = options
    measured = listed([f"{metric_named(name).label.lower()} {_mean(best, name)}" for name in _MEASURED])
    return [
        f"fly {_option(best, by)}: mean {measured} {_of_what(table)}",
        *_rests_on(best),
        *_batteries(best),
        *_lead(best, others, by, limits),
        *_corrected(options),
        *_warnings(best, limits),
        *_left_out(others, by),
        *_averaged(table, by),
    ]


def _of_what(table: pl.DataFrame) -> str:
    """What time and energy are of."""
    if not is_by_mission(table):
        return "a segment, the flight from the base included"
    return f"a mission over {_segments(table)}, the way out and home included"


def _segments(table: pl.DataFrame) -> str:
    """`19 segments`, `17 or 19 segments`."""
    counts = sorted(table[SEGMENTS].unique().to_list())
    words = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return f"{words} segment{'s' * (counts != [1])}"


def _rests_on(best: Row) -> list[str]:
    """How many defects the coverage is a share of."""
    if best["defects"] is None:
        return []
    few = ", so few that its interval is wide" if best["defects"] < FEW_DEFECTS else ""
    return [
        f"the coverage rests on {counted(best['defects'], 'defect')} in {counted(best['replicates'], 'replicate')}{few}"
    ]


def _batteries(best: Row) -> list[str]:
    """How many to bring to a tour: enough for 95 % of the missions; each is changed above its reserve."""
    if best.get(BATTERIES) is None:
        return []
    bring = batteries_to_bring(best)
    mean = amount(metric_named(BATTERIES), best[BATTERIES])
    return [
        f"bring {bring} batter{'y' if bring == 1 else 'ies'}: a mission took {mean} on average, {bring} at the 95th "
        "percentile, each changed in time to be home with its reserve"
    ]


def batteries_to_bring(option: Row) -> int:
    """Full batteries that are enough for 95 % of the missions of an option."""
    return ceil(float(option[f"{BATTERIES}_p95"]) - _SAME)


def _corrected(options: Sequence[Row]) -> list[str]:
    """What is left of the best mean once it is allowed for that it was chosen, and how likely the choice is right."""
    best, rivals = options[0], [other for other in options[1:] if other["certainty"] is not None]
    if best["certainty"] is None or not rivals:
        return []
    expected = amount(metric_named(_COVERAGE), best[f"{_COVERAGE}_expected"])
    return [
        f"corrected for its choice as the best of {len(rivals) + 1}, its coverage is expected at {expected}, and it is "
        f"the best with a probability of {percent(best['certainty'])}"
    ]


def _lead(best: Row, others: Sequence[Row], by: Sequence[str], limits: MissionLimits) -> list[str]:
    """Which options the replicates separate from the best: by its coverage compared in pairs, p not corrected."""
    rivals, count = [other for other in others if other["feasible"]], best["replicates"]
    if not rivals:
        return [f"no other option keeps {limits.words}" if limits.named and others else "there is no other option"]
    if count < FEW:
        replicates = "one replicate is" if count == 1 else f"{count} replicates are"
        return [f"{replicates} too few to separate options: fly at least {FEW}"]
    level = [other for other in rivals if round(other[_COVERAGE], 3) == round(best[_COVERAGE], 3)]  # as printed
    same = [_option(other, by) for other in level if other["same"]]
    dearer = [_option(other, by) for other in level if not other["same"]]
    apart = [other for other in rivals if other not in level and other["p"] is not None]
    close = [f"{_option(other, by)} ({probability(other['p'])})" for other in apart if other["p"] >= _SHOWN]
    leads = f"{f'within {limits.words}, ' if limits.named else ''}{_option(best, by)} leads"
    sentences = []
    if close:
        sentences.append(f"{leads}; {count} replicates cannot separate it from {_first(close)}")
    elif apart:
        rest = _first([_option(other, by) for other in apart])
        sentences.append(f"{leads}; {count} replicates separate it from {rest} (each p < {_SHOWN:g}, not corrected)")
    if same:
        sentences.append(f"{_first(same)} {'are' if len(same) > 1 else 'is'} the same in everything")
    if dearer:
        sentences.append(f"{_first(dearer)} found as much; the choice is by time, then by energy")
    return sentences


def _warnings(best: Row, limits: MissionLimits) -> list[str]:
    unsure = limits.named and best["kept"] is not None and best["kept"] < 0.95
    late = limits.max_time_s is not None and best["time_s_p95"] > limits.max_time_s
    p95 = amount(metric_named(_TIME), best["time_s_p95"])
    warnings = (
        (
            unsure,
            f"its true means may break {limits.words}: with a probability of {percent(1 - (best['kept'] or 0.0))}",
        ),
        (late, f"the limit of time holds for the mean, not for every mission: the 95th percentile is {p95}"),
        (best["failed"], f"{best['failed']} of its missions failed, as with every option, and are in no mean"),
        (best["undefined"], f"in {best['undefined']} of its missions coverage is undefined"),
    )
    return [warning for applies, warning in warnings if applies]


def _left_out(options: Sequence[Row], by: Sequence[str]) -> list[str]:
    """The options that failed where others did not."""
    left = [f"{_option(option, by)} ({option['failed_alone']} failed)" for option in options if option["failed_alone"]]
    return [f"left out, since their means lack missions that others flew: {_first(left)}"] if left else []


def _averaged(table: pl.DataFrame, by: Sequence[str]) -> list[str]:
    """What else the design varies, over which the means are taken."""
    levels = {name: levels_of(table, name) for name in varied_columns(table) if name not in by}
    named = [
        f"{factor_name(name)} ({listed([level_name(level) for level in found])})"
        for name, found in levels.items()
        if len(found) > 1
    ]
    return [f"this is an average over {listed(named)}"] if named else []


def _first(named: Sequence[str]) -> str:
    """The first three, and how many more there are."""
    return listed(named) if len(named) <= 3 else f"{', '.join(named[:3])} and {len(named) - 3} more"


def _option(option: Row, by: Sequence[str]) -> str:
    """`hover at 10 m`: the policy first, as one would say it."""
    rest = [column for column in by if column != "policy"]
    return " ".join([str(option["policy"])] * ("policy" in by) + [setting(option, rest)] * bool(rest))


def _mean(option: Row, name: str) -> str:
    metric, low, high = metric_named(name), option[f"{name}_low"], option[f"{name}_high"]
    interval = f" ({span(metric, low, high)})" if low is not None else ""
    return amount(metric, option[name]) + interval


def _refusal(
    options: Sequence[Row], by: Sequence[str], nearest: Row | None, broken: str | None, limits: MissionLimits
) -> list[str]:
    left = _left_out(options, by)
    if nearest is None or broken is None:
        return ["no option has a coverage, a time and an energy to judge by", *left]
    metric, limit = metric_named(broken), limits.named[broken]
    side = "below" if broken == _COVERAGE else "above"
    found = f", its coverage {amount(metric_named(_COVERAGE), nearest[_COVERAGE])}" if broken != _COVERAGE else ""
    return [
        f"no option keeps {limits.words} on average",
        f"the nearest is {_option(nearest, by)}{found}; what it breaks most is the limit of "
        f"{metric.label.lower()}: {_mean(nearest, broken)} is {side} {amount(metric, limit)}",
        *left,
    ]
