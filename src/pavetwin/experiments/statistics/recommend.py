"""Which option to fly under limits of time, battery and coverage, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import metric_named
from pavetwin.experiments.statistics.bootstrap import resamples, strata
from pavetwin.experiments.statistics.cells import (
    BoolArray,
    FloatArray,
    IntArray,
    failed_alone,
    layout,
    nullable,
    values_of,
    varied_columns,
)
from pavetwin.experiments.statistics.flips import sign_flip_p
from pavetwin.experiments.statistics.summary import FEW, summarise
from pavetwin.experiments.statistics.wording import (
    amount,
    factor_name,
    level_name,
    listed,
    opened,
    percent,
    setting,
    span,
)

_COVERAGE, _TIME, _ENERGY = _MEASURED = ("coverage", "time_s", "energy")
_SPOKEN = ("coverage", "time", "energy")
_SHOWN: Final = 0.05
"""Below this p a difference counts as shown."""
_SAME: Final = 1e-9
"""Coverages closer than this are equal: sums of the same shares in another order."""
_WORTH_SAYING: Final = 0.01
"""Nothing keeps the limits in fewer of the resamples than this: not told."""
_NEAR: Final = 0.01
"""Options that break their limits by this share more than the nearest are as near."""


@dataclass(frozen=True)
class Limits:
    """What an option must keep on average, per segment mission. None: no limit."""

    max_time_s: float | None = None
    max_energy: float | None = None
    """As a share of a battery."""
    min_coverage: float | None = None
    """As a share, 0 … 1."""

    def __post_init__(self) -> None:
        for name, value in (("max-time", self.max_time_s), ("max-energy", self.max_energy)):
            if value is not None and not (isfinite(value) and value > 0):
                raise PaveTwinError(f"--{name}: {value:g} is no limit; give a positive number.")
        if self.min_coverage is not None and not 0 <= self.min_coverage <= 1:
            raise PaveTwinError(f"--min-coverage: {self.min_coverage:g} is no share; give a number from 0 to 1.")

    @property
    def named(self) -> dict[str, float]:
        """The limits that are set, by the metric they hold for."""
        limits = {_COVERAGE: self.min_coverage, _TIME: self.max_time_s, _ENERGY: self.max_energy}
        return {name: limit for name, limit in limits.items() if limit is not None}


@dataclass(frozen=True)
class Recommendation:
    """Every option under the limits, and the best of them."""

    limits: Limits
    by: tuple[str, ...]
    options: pl.DataFrame
    """Best first, then those that break a limit, then those that failed alone. Columns: `*by`, `n` (missions with a
    coverage), `undefined`, `failed`; of coverage, time_s and energy each the mean and `…_low`, `…_high` (95 %
    interval); `time_s_p95`; `failed_alone` (missions that failed and that another option flew: its means leave out
    what it failed on); `replicates` (with a coverage); `feasible` (it failed in none alone and its means keep the
    limits), `kept` (share of the resamples in which they do) and `certainty` (in which it also is the best of all that
    do, or level with the best: these shares may add up to more than 1), both null where there are fewer than five
    replicates; `p` (of its coverage against that of the first); `same` (as the first in coverage, time and energy of
    every replicate)."""
    best: dict[str, Any] | None
    """The first row of `options`; None when no option is feasible."""
    nearest: dict[str, Any] | None
    """When none is feasible: of the options whose worst breach, as a share of the limit, is at most 1 % above the
    smallest, the one with the best coverage."""
    broken: str | None
    """The metric of that worst breach."""
    none_keeps: float | None
    """Share of the resamples in which no option keeps the limits; null where there are fewer than five replicates."""
    sentences: tuple[str, ...]


def recommend(
    table: pl.DataFrame, limits: Limits, by: Sequence[str] = ("altitude_m", "policy"), *, seed: int = 0
) -> Recommendation:
    """The option with the best expected coverage of all whose expected time, energy and coverage keep the limits.

    Equal coverages are told apart by time, then by energy. An option that failed in a mission which another flew is not
    recommended: the two means are over different missions. How sure: replicates are resampled for all options at once,
    which share their traffic, defects and segments, within each world, and the choice is made anew; `certainty` is the
    share of resamples in which the option is the best or level with the best, so that it does not depend on how many
    others do the same.
    """
    metrics = [metric_named(name) for name in _MEASURED]
    summary = summarise(table, by, metrics, seed=seed)
    cells = layout(table, by)
    units = np.stack([cells.means(values_of(table, name)) for name in _MEASURED])
    means = np.stack([summary.filter(metric=name)["mean"].fill_null(float("nan")).to_numpy() for name in _MEASURED])
    alone = np.bincount(cells.cell[failed_alone(table, by)], minlength=len(cells.keys))
    units[:, alone > 0] = means[:, alone > 0] = np.nan
    replicates = np.isfinite(cells.means(values_of(table, _COVERAGE))).sum(axis=1)
    kept, certainty, none = _resampled(units, cells.worlds, limits, seed)
    none_keeps = none if replicates.max() >= FEW else None
    if none_keeps is None:
        kept[:] = certainty[:] = np.nan
    options = _options(summary, by).with_columns(
        failed_alone=alone,
        replicates=replicates,
        feasible=_feasible(means[:, np.newaxis], limits)[0],
        kept=nullable(kept),
        certainty=nullable(certainty),
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
    sentences = (
        _sentences(table, options, by, limits, none_keeps or 0.0)
        if best
        else _refusal(options, by, nearest, broken, limits)
    )
    return Recommendation(limits, tuple(by), options, best, nearest, broken, none_keeps, tuple(sentences))


def _options(summary: pl.DataFrame, by: Sequence[str]) -> pl.DataFrame:
    """One row an option, its metrics side by side."""
    parts = {name: summary.filter(metric=name) for name in _MEASURED}
    frame = parts[_COVERAGE].select(*by, "n", "undefined", "failed")
    for name, part in parts.items():
        frame = frame.with_columns(
            part["mean"].alias(name), part["low"].alias(f"{name}_low"), part["high"].alias(f"{name}_high")
        )
    return frame.with_columns(parts[_TIME]["p95"].alias("time_s_p95"))


def _resampled(units: FloatArray, worlds: IntArray, limits: Limits, seed: int) -> tuple[FloatArray, FloatArray, float]:
    """(options,) shares of the resamples in which an option keeps the limits, and in which it also is the best of all
    that do, or level with the best; and the share in which none keeps them.

    Args:
        units: (3, options, blocks) coverage, time and energy of each replicate, NaN where undefined.
    """
    counts = resamples(strata(worlds), seed)
    drawn = np.einsum("mob,rb->mro", np.isfinite(units), counts, optimize=True).astype(np.float64)
    sums = np.einsum("mob,rb->mro", np.nan_to_num(units), counts, optimize=True)
    means = np.divide(sums, drawn, out=np.full(drawn.shape, np.nan), where=drawn > 0)
    feasible = _feasible(means, limits)
    chosen = feasible.copy()
    for name, sign in ((_COVERAGE, -1.0), (_TIME, 1.0), (_ENERGY, 1.0)):
        value = np.where(chosen, sign * means[_MEASURED.index(name)], np.inf)
        least = value.min(axis=1, keepdims=True)
        chosen &= value <= least + _SAME * np.maximum(np.abs(np.where(np.isfinite(least), least, 0.0)), 1.0)
    return feasible.mean(axis=0), chosen.mean(axis=0), float(1 - feasible.any(axis=1).mean())


def _feasible(means: FloatArray, limits: Limits) -> BoolArray:
    """(resamples, options) of (3, resamples, options) means; what is undefined keeps no limit."""
    coverage, time_s, energy = means
    kept = ~np.isnan(means).any(axis=0)
    if limits.min_coverage is not None:
        kept &= coverage >= limits.min_coverage - _SAME
    if limits.max_time_s is not None:
        kept &= time_s <= limits.max_time_s * (1 + _SAME)
    if limits.max_energy is not None:
        kept &= energy <= limits.max_energy * (1 + _SAME)
    return np.asarray(kept)


def _nearest(options: pl.DataFrame, limits: Limits) -> tuple[dict[str, Any] | None, str | None]:
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


def _sentences(
    table: pl.DataFrame, options: pl.DataFrame, by: Sequence[str], limits: Limits, none_keeps: float
) -> list[str]:
    best, *others = options.to_dicts()
    expected = [f"{name} {_expected(best, column)}" for name, column in zip(_SPOKEN, _MEASURED, strict=True)]
    fly = f"fly {_option(best, by)}: expected {listed(expected)} a segment, the way there from the base included"
    sure = _how_sure(best, others, by, none_keeps=none_keeps if limits.named else None)
    sentences = [fly, sure, *_unshown(best, others, by), *_same(best, others, by), *_warnings(best, limits)]
    return [opened(sentence) for sentence in [*sentences, *_left_out(others, by), *_averaged(table, by)]]


def _warnings(best: dict[str, Any], limits: Limits) -> list[str]:
    warnings = []
    if limits.named and best["kept"] is not None and best["kept"] < 0.95:
        broken = percent(1 - best["kept"])
        warnings.append(f"that it keeps the limits on average is not sure: in {broken} of the resamples it does not")
    if limits.max_time_s is not None and best["time_s_p95"] > limits.max_time_s:
        over = amount(metric_named(_TIME), best["time_s_p95"])
        warnings.append(f"the limit of time holds on average only: the 95th percentile is {over}")
    if best["failed"]:
        warnings.append(f"{best['failed']} of its missions failed, as with every option, and are in no mean")
    if best["undefined"]:
        warnings.append(f"in {best['undefined']} of its missions coverage is undefined")
    return warnings


def _left_out(options: Sequence[dict[str, Any]], by: Sequence[str]) -> list[str]:
    """The options that failed where others did not."""
    left = [option for option in options if option["failed_alone"]]
    named = [f"{_option(option, by)} ({option['failed_alone']} failed)" for option in left[:3]]
    more = f" and {len(left) - 3} more" if len(left) > 3 else ""
    return [f"left out, since their means lack missions that others flew: {listed(named)}{more}"] if left else []


def _averaged(table: pl.DataFrame, by: Sequence[str]) -> list[str]:
    """What else the design varies, over which the expected values are averages."""
    levels = {column: table[column].unique(maintain_order=True).to_list() for column in varied_columns(table)}
    named = [
        f"{factor_name(column)} ({listed([level_name(level) for level in found])})"
        for column, found in levels.items()
        if column not in by and len(found) > 1
    ]
    return [f"this is an average over {listed(named)}"] if named else []


def _option(option: dict[str, Any], by: Sequence[str]) -> str:
    """`hover at 10 m`: the policy first, as one would say it."""
    rest = [column for column in by if column != "policy"]
    return " ".join([str(option["policy"])] * ("policy" in by) + [setting(option, rest)] * bool(rest))


def _expected(option: dict[str, Any], name: str) -> str:
    metric, low, high = metric_named(name), option[f"{name}_low"], option[f"{name}_high"]
    interval = f" ({span(metric, low, high)})" if low is not None else ""
    return amount(metric, option[name]) + interval


def _how_sure(
    best: dict[str, Any], others: Sequence[dict[str, Any]], by: Sequence[str], *, none_keeps: float | None
) -> str:
    """Args:
    none_keeps: share of the resamples in which no option keeps the limits; None where there are no limits.
    """
    if best["coverage_low"] is None:
        return "one replicate says nothing of how sure this is"
    certainty = best["certainty"]
    if certainty is None:
        return f"{best['replicates']} replicates are too few to say how sure this is: fly at least {FEW}"
    if not any(other["kept"] > 0 for other in others):
        limited = none_keeps is not None and others
        return "no other option keeps the limits" if limited else "there is no other option to choose from"
    shown = not _doubtful(best, others)
    word = "very sure" if certainty >= 0.95 and shown else "fairly sure" if certainty >= 0.8 and shown else "not sure"
    rivals = [other for other in others if other["certainty"] >= 0.05 and not other["same"]]
    rivals.sort(key=lambda other: -other["certainty"])
    named = [f"{_option(other, by)} in {percent(other['certainty'])}" for other in rivals[:3]]
    # The limits are judged anew in each resample: what breaks them on average may keep them in some.
    best_in = (
        f"of all options it is the best in {percent(certainty)} of the resamples"
        if none_keeps is None
        else f"in {percent(certainty)} of the resamples it keeps the limits and is the best of all that do"
    )
    nothing = f"; in {percent(none_keeps)} nothing keeps them" if none_keeps and none_keeps >= _WORTH_SAYING else ""
    return f"this is {word}: {', '.join([best_in, *([listed(named)] if named else [])])}{nothing}"


def _unshown(best: dict[str, Any], others: Sequence[dict[str, Any]], by: Sequence[str]) -> list[str]:
    """The options whose coverage pairs do not show to be less, though a resample seldom says so where few differ."""
    if best["certainty"] is None:
        return []
    doubtful = _doubtful(best, others)
    named = [f"{_option(other, by)} (p = {other['p']:.2g})" for other in doubtful[:3]]
    more = f" and {len(doubtful) - 3} more" if len(doubtful) > 3 else ""
    return (
        [f"compared in pairs its coverage is not shown to be more than that of {listed(named)}{more}"] if named else []
    )


def _doubtful(best: dict[str, Any], others: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        other
        for other in others
        if other["feasible"]
        and other["p"] is not None
        and other["p"] >= _SHOWN
        and not _equal(best[_COVERAGE], other[_COVERAGE])
    ]


def _same(best: dict[str, Any], others: Sequence[dict[str, Any]], by: Sequence[str]) -> list[str]:
    """That options with the same coverage were told apart by what they cost, if they could be."""
    level = [other for other in others if other["feasible"] and _equal(best[_COVERAGE], other[_COVERAGE])]
    same = [_option(other, by) for other in level if other["same"]]
    dearer = [_option(other, by) for other in level if not other["same"]]
    more = f" and {len(same) - 3} more" if len(same) > 3 else ""
    are = "are" if len(same) > 1 else "is"
    return [
        *([f"{listed(same[:3])}{more} {are} the same in everything"] if same else []),
        *([f"{listed(dearer[:3])} found as much; the choice is by time, then by energy"] if dearer else []),
    ]


def _equal(one: float, other: float | None) -> bool:
    """As they are printed."""
    return other is not None and round(one, 3) == round(other, 3)


def _refusal(
    options: pl.DataFrame, by: Sequence[str], nearest: dict[str, Any] | None, broken: str | None, limits: Limits
) -> list[str]:
    left = [opened(sentence) for sentence in _left_out(options.to_dicts(), by)]
    if nearest is None or broken is None:
        return ["No option has a coverage, a time and an energy to judge by.", *left]
    metric, limit = metric_named(broken), limits.named[broken]
    side = "below" if broken == _COVERAGE else "above"
    found = f", its coverage {amount(metric_named(_COVERAGE), nearest[_COVERAGE])}" if broken != _COVERAGE else ""
    return [
        "No option keeps the limits on average.",
        opened(f"the nearest is {_option(nearest, by)}{found}; what it breaks most is the limit of "
               f"{metric.label.lower()}: {_expected(nearest, broken)} is {side} {amount(metric, limit)}"),
        *left,
    ]  # fmt: skip
