"""Which option to fly under limits of time, battery and coverage, and how sure that is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.metrics import (
    BATTERIES,
    ERROR_METRICS,
    INDEX_ERROR,
    TOUR_METRICS,
    has_detected,
    metric_named,
    metrics_in,
)
from pavetwin.experiments.statistics.cells import failed_alone, layout, nullable, values_of
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
from pavetwin.experiments.statistics.flips import sign_flip_p
from pavetwin.experiments.statistics.proposal import proposal, refusal
from pavetwin.experiments.statistics.sensor_errors import sensor_errors, widened
from pavetwin.experiments.statistics.summary import FEW, summarise
from pavetwin.reports.words import opened

UNMEASURED: Final = (
    "no mission has a condition index by what was detected: their sensor measures no sizes, they failed, or they are "
    "of an earlier version"
)


@dataclass(frozen=True)
class Recommendation:
    """Every option under the limits, and the best of them."""

    limits: MissionLimits
    objective: Objective
    by: tuple[str, ...]
    options: pl.DataFrame
    """Best first, then those that break a limit, then those that failed alone. Columns: `*by`, `n` (missions with a
    coverage), `undefined`, `failed`, `defects` (that the coverage rests on, null where the table has none); of
    coverage, time_s, energy and what else the objective judges by each the mean, `…_low`, `…_high` (95 % interval) and
    `…_expected` (the mean corrected for the choice among many, see `true_means`); `time_s_p95`; the means of
    `ERROR_METRICS` where a sensor made such errors, and of `INDEX_ERROR` where it measured; of tours `batteries` (mean)
    and `batteries_p95`;
    `failed_alone` (missions that failed and that another option flew:
    its means leave out what it failed on); `coverage_replicates` and `replicates` (with a coverage, and with all that
    the objective judges by); `unmeasured` (the objective judges by what a sensor measured, and too few replicates have
    that to compare the option); `feasible` (it failed in none alone, it is not unmeasured, and its means keep the
    limits), `kept` (the probability that its true means do) and `certainty` (that it also is the best of all that do,
    or level with the best: these may add up to more than 1), as `…_expected` null where no option has five replicates,
    and where it is unmeasured; `p` (of the metric that decides, against that of the first; null where the altitude
    decides); `same` (as the first in everything that is judged, in every replicate)."""
    best: Row | None
    """The first row of `options`; None when no option is feasible."""
    nearest: Row | None
    """When none is feasible: of the options whose worst breach, as a share of the limit, is at most 1 % above the
    smallest, the best."""
    broken: str | None
    """The metric of that worst breach."""
    sentences: tuple[str, ...]
    is_measured: bool = True
    """Whether what decides was measured of any option; what was detected is by some sensors alone."""


def recommend(
    table: pl.DataFrame,
    limits: MissionLimits,
    by: Sequence[str] = (ALTITUDE, "policy"),
    *,
    objective: Objective = Objective.MOST_FOUND,
    seed: int = 0,
) -> Recommendation:
    """The best option of all whose mean time, energy and coverage keep the limits: with the best mean coverage, or by
    another objective.

    Options that are level in what decides are told apart by coverage, time and energy, in this order. An option that
    failed in a mission which another flew is not recommended: the two means are over different missions. Nor is one
    with fewer than five replicates in which a sensor measured what decides, where another has more. How sure: the
    choice is made again in each draw of the true means (`true_means`: shrunk, so that the best of many is not believed
    for its random errors); `certainty` is the share of draws in which the option is the best or level with the best, so
    that it does not depend on how many others do the same.

    Raises:
        PaveTwinError: the objective is another than the most found, and nothing says how much must be found; or it is
            the highest, and `by` has no altitude.
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
    rows = options.to_dicts()
    if not is_measured:
        nearest, broken, sentences = None, None, [UNMEASURED]
    elif best:
        sentences = proposal(table, rows, by, limits, objective)
    else:
        sentences = refusal(rows, by, nearest, broken, limits, objective)
    said = tuple(map(opened, sentences))
    return Recommendation(limits, objective, tuple(by), options, best, nearest, broken, said, is_measured)


def _check(limits: MissionLimits, by: Sequence[str], objective: Objective) -> None:
    if objective.needs_coverage and not limits.min_coverage:
        raise PaveTwinError(
            f"`objective` {objective}: without a least coverage above 0 that may be an option that finds nothing; give "
            "`min_coverage`."
        )
    if objective is Objective.HIGHEST and ALTITUDE not in by:
        raise PaveTwinError(f"`objective` {objective}: the options have no altitude; name `{ALTITUDE}` in `by`.")


def _separated(units: Float64Array, objective: Objective, seed: int) -> Float64Array:
    """(options,) p of what decides against that of the first option, in pairs; NaN where nothing measured decides."""
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
