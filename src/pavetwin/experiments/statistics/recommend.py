"""The option to fly under limits of time, battery and coverage, and the evidence for it.

Replicates share the parameters of a fitted sensor, so more replicates do not reduce the sensor's uncertainty. Each
mission therefore stores its expected coverage in draws of these parameters (`pavetwin.sensing.Sensor.found_by_draws`,
the same draws in all missions), and the change of a cell's mean from draw to draw is added to the uncertainty from
replicates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import (
    BATTERIES,
    COVERAGE_DRAWS,
    ERROR_METRICS,
    INDEX_ERROR,
    TOUR_METRICS,
    has_detected,
    metric_named,
    metrics_in,
)
from pavetwin.experiments.statistics.bootstrap import centres
from pavetwin.experiments.statistics.cells import Layout, failed_alone, layout, nullable, values_of
from pavetwin.experiments.statistics.choice import (
    ALTITUDE,
    COVERAGE,
    SAME,
    TIME,
    Chances,
    MissionLimits,
    Objective,
    Row,
    choice_under,
    keeping,
    nearest_of,
)
from pavetwin.experiments.statistics.simultaneous import sign_flip_p
from pavetwin.experiments.statistics.summary import FEW, summarise
from pavetwin.experiments.tours import is_by_mission
from pavetwin.experiments.words import amount, difference, option_text, span
from pavetwin.reports.words import counted, listed, opened, percent, probability

UNMEASURED: Final = (
    "no mission has a condition index of its detections: the sensor measures no sizes, or all of its missions failed"
)


@dataclass(frozen=True)
class Recommendation:
    """Every option under the limits, and the best of them."""

    limits: MissionLimits
    objective: Objective
    by: tuple[str, ...]
    options: pl.DataFrame
    """One row per option, best first, then those that break a limit, then those with failures of their own.

    - `*by`, `n` (missions with a coverage), `undefined`, `failed`, `defects` (under the coverage; null if unknown).
    - For coverage, time_s, energy and the metric of the objective: the mean, `…_low` and `…_high` (95 % interval) and
      `…_expected` (the mean corrected for the choice among many). `time_s_p95`. Means of `ERROR_METRICS` and
      `INDEX_ERROR` where measured. For tours `batteries` (mean) and `batteries_p95`.
    - `failed_alone`: missions that failed and that another option flew; the means leave them out.
    - `coverage_replicates` and `replicates`: those with a coverage, and those with every metric of the objective.
      `unmeasured`: too few replicates have the measured metric of the objective.
    - `feasible`: the means keep the limits, and the option neither failed alone nor is unmeasured. `kept`: probability
      that the true means keep the limits. `certainty`: probability that the option also is the best, or level with the
      best; the sum over options may exceed 1. Both, and `…_expected`, are null with fewer than five replicates.
    - `p` of the deciding metric against the first option, in pairs; null if the altitude decides. `same`: equal to the
      first option in every replicate.
    """
    best: Row | None
    """The first row of `options`; None when no option is feasible."""
    nearest: Row | None
    """When none is feasible: the best of the options whose worst breach, as a share of the limit, is within 1 % of the
    smallest."""
    broken: str | None
    """The metric of that worst breach."""
    unit: str = "segment"
    """Reference of time and energy: a segment, or a mission for tours."""
    is_measured: bool = True
    """False if the objective's metric was measured for no option."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """The proposal in at most three sentences: the option, its lead over the next one, and its probability."""
        if self.best is None:
            return (opened(self._refusal() if self.is_measured else UNMEASURED),)
        return tuple(map(opened, (self._proposal(self.best), self._lead(), self._probability(self.best))))

    @property
    def next_option(self) -> Row | None:
        """The best of the other options that keep the limits and differ from the first."""
        rows = self.options.filter("feasible", ~pl.col("same")).head(1).to_dicts()
        return rows[0] if self.best is not None and rows else None

    def lead(self) -> str:
        """The difference to the next option in what decides: `4.2 percentage points`; empty without a next option."""
        other, decides = self.next_option, self.objective.order[0]
        if self.best is None or other is None:
            return ""
        gap = abs(self.best[decides] - other[decides])
        return f"{gap:g} m" if decides == ALTITUDE else difference(metric_named(decides), gap)

    def _proposal(self, best: Row) -> str:
        means = listed([f"{metric_named(name).label.lower()} {_mean(best, name)}" for name in self.objective.judged])
        return f"fly {option_text(best, self.by)}: mean {means} per {self.unit}"

    def _lead(self) -> str:
        other, decides = self.next_option, self.objective.order[0]
        if other is None:
            equal = self.options.filter("feasible").height - 1
            if equal:
                return f"{counted(equal, 'other option')} had the same results"
            return "no other option keeps the limits" if self.limits.named else "there is no other option to compare"
        what = "altitude" if decides == ALTITUDE else metric_named(decides).label.lower()
        tested = "" if other["p"] is None else f" ({probability(other['p'])}, not corrected)"
        return f"its lead over the next option, {option_text(other, self.by)}, is {self.lead()} of {what}{tested}"

    def _probability(self, best: Row) -> str:
        if best["certainty"] is None:
            return f"with fewer than {FEW} replicates the probability of the choice is unknown"
        compared = self.options["certainty"].count()
        kept = f", it keeps the limits with {percent(best['kept'])}" if self.limits.named else ""
        sure = percent(best["certainty"])
        expected = amount(metric_named(COVERAGE), best[f"{COVERAGE}_expected"])
        return (
            f"it is the best of {counted(compared, 'option')} with a probability of {sure}{kept}, "
            f"and its coverage corrected for the choice is {expected}"
        )

    def _refusal(self) -> str:
        option, name = self.nearest, self.broken
        if option is None or name is None:
            return "no option has a mean of every metric that decides"
        metric, side = metric_named(name), "below" if name == COVERAGE else "above"
        return (
            f"no option keeps the limits on average; the nearest is {option_text(option, self.by)}, whose "
            f"{metric.label.lower()} of {_mean(option, name)} is {side} {amount(metric, self.limits.named[name])}"
        )


def _mean(option: Row, name: str) -> str:
    metric, low, high = metric_named(name), option[f"{name}_low"], option[f"{name}_high"]
    return amount(metric, option[name]) + (f" ({span(metric, low, high)})" if low is not None else "")


def batteries_to_bring(option: Row) -> int:
    """Full batteries that are enough for 95 % of the missions of an option."""
    return ceil(float(option[f"{BATTERIES}_p95"]) - SAME)


def recommend(
    table: pl.DataFrame,
    limits: MissionLimits,
    by: Sequence[str] = (ALTITUDE, "policy"),
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
) -> Recommendation:
    """Choose the best of the options whose mean time, energy and coverage keep the limits.

    Coverage, time and energy, in this order, decide between options that are level in the objective. An option that
    failed in a mission which another flew is not recommended, since the two means are over different missions; nor is
    one with fewer than five measured replicates where another has more. `certainty` is the share of draws of the true
    means (`choice.true_means`) in which the option is the best or level with the best.

    Args:
        table: one row per segment mission, or per mission for tours (`tours.by_mission`).
        by: the columns whose levels make an option.

    Raises:
        PaveTwinError: the objective needs a least coverage that the limits do not set, or an altitude that `by` does
            not have.
    """
    _check(limits, by, objective)
    judged = objective.judged
    shown = (*TOUR_METRICS, *ERROR_METRICS, metric_named(INDEX_ERROR))
    others = [metric for metric in metrics_in(table) if metric in shown and metric.name not in judged]
    summary = summarise(table, by, [*map(metric_named, judged), *others], seed=seed)
    cells = layout(table, by)
    units = np.stack([cells.means(values_of(table, name)) for name in judged])
    means = np.stack([summary.filter(metric=name)["mean"].fill_null(float("nan")).to_numpy() for name in judged])
    alone = np.bincount(cells.cell[failed_alone(table, by)], minlength=len(cells.keys))
    counts = np.isfinite(units).sum(axis=2)
    replicates = counts.min(axis=0)
    unmeasured = (replicates < min(FEW, max(replicates.max(), 1))) & (INDEX_ERROR in judged)
    left_out = (alone > 0) | unmeasured
    units[:, left_out] = means[:, left_out] = np.nan
    levels = [np.unique([str(key[at]) for key in cells.keys], return_inverse=True)[1] for at in range(len(by))]
    is_measured = INDEX_ERROR not in judged or has_detected(table)
    if replicates.max() < FEW or not is_measured:
        chances = Chances(*(np.full(shape, np.nan) for shape in (len(alone), len(alone), units.shape[:2])))
    else:
        altitudes_m = np.array([key[by.index(ALTITUDE)] for key in cells.keys]) if ALTITUDE in by else None
        chances = choice_under(
            limits,
            units,
            cells.worlds,
            levels,
            seed,
            objective=objective,
            altitudes_m=altitudes_m,
            sensor_errors=sensor_errors(table, cells),
        )
    options = widened(_options(summary, by, judged), sensor_errors(table, cells)).with_columns(
        failed_alone=alone,
        coverage_replicates=counts[judged.index(COVERAGE)],
        replicates=replicates,
        unmeasured=unmeasured,
        feasible=keeping(means[:, np.newaxis], limits)[0],
        kept=nullable(np.where(unmeasured, np.nan, chances.kept)),
        certainty=nullable(np.where(unmeasured, np.nan, chances.certainty)),
        **{f"{name}_expected": nullable(row) for name, row in zip(judged, chances.expected, strict=True)},
    )
    decides = list(dict.fromkeys((*objective.order, *judged)))
    options = options.with_row_index("at").sort(
        ["feasible", pl.col("failed_alone") > 0, *decides],
        descending=[True, False, *(name in (ALTITUDE, COVERAGE) for name in decides)],
        nulls_last=True,
        maintain_order=True,
    )
    units = units[:, options["at"].to_numpy()]
    options = options.drop("at").with_columns(
        p=nullable(_separated(units, objective, seed)),
        same=np.asarray(np.isclose(units, units[:, :1], rtol=SAME, atol=SAME, equal_nan=True).all(axis=(0, 2))),
    )
    best = options.row(0, named=True) if options["feasible"].any() else None
    nearest, broken = (None, None) if best else nearest_of(options.to_dicts(), limits)
    if not is_measured:
        nearest, broken = None, None
    unit = "mission" if is_by_mission(table) else "segment"
    return Recommendation(limits, objective, tuple(by), options, best, nearest, broken, unit, is_measured)


def _check(limits: MissionLimits, by: Sequence[str], objective: Objective) -> None:
    if objective.needs_coverage and not limits.min_coverage:
        raise PaveTwinError(
            f"`objective` {objective}: without a least coverage above 0 an option that finds nothing may win; give "
            "`min_coverage`."
        )
    if objective is Objective.HIGHEST and ALTITUDE not in by:
        raise PaveTwinError(f"`objective` {objective}: the options have no altitude; name `{ALTITUDE}` in `by`.")


def _separated(units: Float64Array, objective: Objective, seed: int) -> Float64Array:
    """(options,) p of the deciding metric against the first option, in pairs; NaN if the altitude decides."""
    if objective.order[0] not in objective.judged:
        return np.full(units.shape[1], np.nan)
    values = units[objective.judged.index(objective.order[0])]
    return sign_flip_p(values[:1] - values, seed)


def _options(summary: pl.DataFrame, by: Sequence[str], judged: Sequence[str]) -> pl.DataFrame:
    parts = {name: summary.filter(metric=name) for name in judged}
    frame = parts[COVERAGE].select(*by, "n", "undefined", "failed", "defects")
    for name, part in parts.items():
        frame = frame.with_columns(
            part["mean"].alias(name), part["low"].alias(f"{name}_low"), part["high"].alias(f"{name}_high")
        )
    rest = (*TOUR_METRICS, *ERROR_METRICS, metric_named(INDEX_ERROR))
    others = {metric.name: summary.filter(metric=metric.name) for metric in rest if metric.name not in judged}
    shown = [part["mean"].alias(name) for name, part in others.items() if part.height]
    shown += [part["p95"].alias(f"{BATTERIES}_p95") for part in [others[BATTERIES]] if part.height]
    return frame.with_columns(parts[TIME]["p95"].alias("time_s_p95"), *shown)


def sensor_errors(table: pl.DataFrame, cells: Layout) -> Float64Array | None:
    """(cells, draws) change of a cell's mean coverage with each draw of the sensor's parameters.

    Returns:
        None if no sensor was fitted; 0 in cells of other sensors.
    """
    if any(name not in table.columns for name in COVERAGE_DRAWS):
        return None
    means = np.stack([centres(cells.means(values_of(table, name))) for name in COVERAGE_DRAWS], axis=1)
    return np.asarray(np.nan_to_num(means - means.mean(axis=1, keepdims=True)))


def widened(options: pl.DataFrame, errors: Float64Array | None) -> pl.DataFrame:
    """Options whose interval of coverage includes the sensor's error, as if both were normal, within 0 and 1."""
    if errors is None:
        return options
    error = pl.Series(1.96 * errors.std(axis=1, ddof=1))
    mean, low, high = (pl.col(name) for name in ("coverage", "coverage_low", "coverage_high"))
    return options.with_columns(
        (mean - ((mean - low) ** 2 + error**2).sqrt()).clip(0.0, 1.0).alias("coverage_low"),
        (mean + ((high - mean) ** 2 + error**2).sqrt()).clip(0.0, 1.0).alias("coverage_high"),
    )
