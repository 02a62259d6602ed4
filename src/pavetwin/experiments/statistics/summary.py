"""Every cell of a study in numbers: centre, spread, interval and tail of each metric."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.experiments.metrics import METRICS, Metric
from pavetwin.experiments.statistics.bootstrap import centres, intervals, strata, variance_of_mean
from pavetwin.experiments.statistics.cells import Layout, failures, key_columns, layout, nullable, values_of
from pavetwin.mission.metrics import limits, usual_of_street

FEW: Final = 5
"""With fewer values in a cell the certainty of its mean is unknown."""


def summarise(
    table: pl.DataFrame, by: Sequence[str], metrics: Sequence[Metric] = METRICS, *, seed: int = 0
) -> pl.DataFrame:
    """One row a cell and metric, in the units of the table.

    Cells are sorted by the first appearance of their levels, column by column, and metrics within them.

    Columns: `*by`, `metric`, `n` (defined values), `undefined` (flown, but null), `failed`, `defects` (how many the
    mean of a share of defects rests on, each replicate's counted once), `mean`, `sd` (n − 1), `low` and `high` (95 %
    interval of the mean, see `bootstrap`; of a share of defects at least as wide as `mission.found_share` has it),
    `median`, `p95` (linearly interpolated), `maximum`.
    `mean` gives every replicate the same weight, also where a cell has several missions of each. Null is what too few
    values define: `sd` of one, an interval of one replicate, anything of none.
    """
    cells = layout(table, by)
    frames = [_of_metric(table, cells, metric, seed) for metric in metrics]
    return interleaved(key_columns(table, by, cells.keys), frames)


def interleaved(keys: pl.DataFrame, frames: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """Frames of equal height as one, `keys` before each: their first rows, their second rows, and so on."""
    order = np.arange(len(frames) * keys.height).reshape(len(frames), -1).T.ravel()
    return pl.concat([pl.concat([keys, frame], how="horizontal") for frame in frames])[order]


def _of_metric(table: pl.DataFrame, cells: Layout, metric: Metric, seed: int) -> pl.DataFrame:
    values, failed = values_of(table, metric.name), failures(table)
    undefined = np.isnan(values)
    number = len(cells.keys)
    defined = [values[(cells.cell == cell) & ~undefined] for cell in range(number)]
    units = cells.means(values)
    low, high = within_range(metric, *intervals(units, cells.worlds, seed))
    defects, usual = _rests_on(table, cells, metric)
    low, high = _of_few_defects(units, defects, usual, cells.worlds, low, high)
    return pl.DataFrame(
        {
            "metric": pl.Series([metric.name] * number, dtype=pl.String),
            "n": pl.Series([len(part) for part in defined], dtype=pl.Int64),
            "undefined": np.bincount(cells.cell[undefined & ~failed], minlength=number),
            "failed": np.bincount(cells.cell[failed], minlength=number),
            "defects": nullable(defects.sum(axis=1).round()).cast(pl.Int64).replace(0, None),
            "mean": nullable(centres(units)),
            "sd": nullable([float(np.sort(part).std(ddof=1)) if len(part) > 1 else np.nan for part in defined]),
            "low": nullable(low),
            "high": nullable(high),
            **{
                name: nullable([float(np.quantile(part, share)) if len(part) else np.nan for part in defined])
                for name, share in (("median", 0.5), ("p95", 0.95), ("maximum", 1.0))
            },
        }
    )


def _rests_on(table: pl.DataFrame, cells: Layout, metric: Metric) -> tuple[Float64Array, Float64Array]:
    """(cells, blocks) how many defects a value is a share of, and its usual variance as a multiple of p (1 − p).

    A value is the mean of its segments' shares. The missions of a block share its defects: each counts once. Both are 0
    where there is no value, or none that is such a share.
    """
    shape = len(cells.keys), len(cells.worlds)
    if metric.of not in table.columns:
        return np.zeros(shape), np.zeros(shape)
    defects = values_of(table, metric.of)
    rests = ~np.isnan(values_of(table, metric.name)) & (defects > 0)
    names, segment = np.unique(_segments(table), return_inverse=True)
    place = (cells.cell * shape[1] + cells.block) * len(names) + segment
    places, which = np.unique(place[rests], return_inverse=True)
    own = np.bincount(which, weights=defects[rests]) / np.bincount(which)
    blocks = places // len(names)

    def summed(values: Float64Array | None) -> Float64Array:
        return np.bincount(blocks, weights=values, minlength=shape[0] * shape[1]).reshape(shape).astype(np.float64)

    segments = summed(None)
    return summed(own), summed(usual_of_street(own)) / np.maximum(segments, 1) ** 2


def _segments(table: pl.DataFrame) -> list[str]:
    return (
        table["segment"].cast(pl.String).fill_null("").to_list() if "segment" in table.columns else [""] * table.height
    )


def _of_few_defects(
    units: Float64Array,
    defects: Float64Array,
    usual: Float64Array,
    worlds: IndexArray,
    low: Float64Array,
    high: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Limits at least as far apart as the number of defects allows."""
    low, high = low.copy(), high.copy()
    for cell in np.flatnonzero(np.isfinite(low) & (defects.sum(axis=1) > 0)):
        here = defects[cell] > 0
        values, counts, sizes = units[cell, here], defects[cell, here], strata(worlds[here])
        if len(values) > len(sizes):
            share, variance = float(centres(values[np.newaxis])[0]), variance_of_mean(values, sizes)
            of_mean = float(usual[cell, here].mean()) / len(values)
            ends = limits(share, variance, of_mean, len(values) - len(sizes), round(float(counts.sum())))
            low[cell], high[cell] = min(low[cell], ends[0]), max(high[cell], ends[1])
    return low, high


def within_range(metric: Metric, low: Float64Array, high: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Limits clipped to the range of the metric: only signed metrics are negative, a share is at most 1."""
    return low if metric.signed else np.maximum(low, 0.0), np.minimum(high, 1.0) if metric.unit == "%" else high
