"""Differences between the levels of a factor, compared in pairs: same traffic, defects and segment, another policy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.arrays import BoolArray, Float64Array
from pavetwin.experiments.metrics import COMPARED, REFERENCE, Metric, metric_named
from pavetwin.experiments.statistics.bootstrap import centres
from pavetwin.experiments.statistics.cells import (
    CellKey,
    key_columns,
    layout,
    levels_of,
    nullable,
    partners,
    values_of,
    varied_columns,
)
from pavetwin.experiments.statistics.simultaneous import ALPHA, simultaneous
from pavetwin.experiments.statistics.summary import interleaved

_COMPARED: Final = tuple(metric_named(name) for name in COMPARED)


@dataclass(frozen=True)
class Comparison:
    """The levels of a factor, each compared with one of them."""

    factor: str
    reference: Any
    reason: str
    """Reason for the choice of the reference; empty for the usual one."""
    differences: pl.DataFrame
    """Result of the function `differences`."""
    family: int = 0
    """Number of tests in the family if these are only some of them, else 0."""

    @property
    def number(self) -> int:
        """Number of tests in the family."""
        return self.family or self.differences["p"].count()


def is_significant(difference: Mapping[str, Any]) -> bool:
    """True if the corrected p of a row of `differences` is below 0.05, so that its interval excludes 0."""
    p = difference["p_corrected"]
    return p is not None and p < ALPHA


def differences(
    table: pl.DataFrame,
    by: Sequence[str],
    metrics: Sequence[Metric] = _COMPARED,
    *,
    factor: str = "policy",
    reference: Any = REFERENCE,
    seed: int = 0,
) -> pl.DataFrame:
    """Level − reference of `factor`, for every other level and every cell of the other columns of `by`.

    A pair agrees in world, replicate and everything else that the design varies, as far as both have it: a policy that
    does not have a swept setting is compared at each of its levels by its one set of missions. Where `by` leaves
    some of that out, a replicate's pairs are averaged first, since they are not independent. A pair with an
    undefined or failed side is left out and counted.

    Columns: `*by` (that of the factor holds the level compared), `metric`, `pairs` (replicates with a difference),
    `undefined` (replicates without), `mean`, `low`, `high` (simultaneous 95 % interval), `p` (of this comparison by
    itself), `p_corrected` (both over all rows of the frame together, see `simultaneous`: below 0.05 just where the
    interval excludes 0), `dz` (mean / SD of the differences). Null is what fewer than two pairs do not define, ends of
    an interval that are nowhere, and `dz` where all differences are equal. Empty where the reference is not in the
    table.

    Raises:
        ValueError: `by` does not contain the factor.
    """
    if factor not in by:
        raise ValueError(f"by: {list(by)} does not contain the factor '{factor}' whose levels are compared.")
    others = [level for level in levels_of(table, factor) if level != reference]
    return _together(table, by, metrics, [_Pairing(table, by, factor, reference, others)], seed)[0]


def every_pair(
    table: pl.DataFrame, by: Sequence[str], levels: Sequence[Any], *, factor: str, seed: int = 0
) -> list[Comparison]:
    """Each level of `factor` with every one before it in `levels`: all tests are one family.

    Returns:
        One comparison a reference, with the later levels.
    """
    pairings = [_Pairing(table, by, factor, level, levels[at:]) for at, level in enumerate(levels[:-1], start=1)]
    frames = _together(table, by, _COMPARED, pairings, seed)
    family = sum(frame["p"].count() for frame in frames)
    return [
        Comparison(factor, reference, "", frame, family)
        for reference, frame in zip(levels[:-1], frames, strict=True)
        if frame.height
    ]


def _together(
    table: pl.DataFrame, by: Sequence[str], metrics: Sequence[Metric], pairings: "Sequence[_Pairing]", seed: int
) -> list[pl.DataFrame]:
    """The differences of each pairing, all tested together."""
    if not pairings:
        return []
    made = [[pairing.differences(values_of(table, metric.name)) for metric in metrics] for pairing in pairings]
    units = np.concatenate([units for parts in made for units, _ in parts])
    tests = np.stack(simultaneous(units, pairings[0].cells.worlds, seed))
    frames, start = [], 0
    for pairing, parts in zip(pairings, made, strict=True):
        of_metrics = []
        for metric, part in zip(metrics, parts, strict=True):
            of_metrics.append(_frame(metric, *part, tests[:, start : start + len(pairing.keys)]))
            start += len(pairing.keys)
        frames.append(interleaved(key_columns(table, by, pairing.keys), of_metrics))
    return frames


class _Pairing:
    """The compared cells of the whole design, and the cell of `by` of each comparison."""

    def __init__(
        self, table: pl.DataFrame, by: Sequence[str], factor: str, reference: Any, levels: Sequence[Any]
    ) -> None:
        others = [column for column in varied_columns(table) if column not in by]
        self.table = table
        # `by` comes first, so that its cells keep the order that `summarise` gives them.
        self.cells = layout(table, [*by, *others])
        at = list(by).index(factor)
        found = sorted(pair for pair in partners(self.cells.keys, at, reference) if pair[2][at] in levels)
        self.level = np.array([cell for cell, _, _ in found], dtype=np.intp)
        self.reference = np.array([partner for _, partner, _ in found], dtype=np.intp)
        ordered: dict[CellKey, int] = {}
        self.group = [ordered.setdefault(key[: len(by)], len(ordered)) for _, _, key in found]
        self.keys = tuple(ordered)

    def differences(self, values: Float64Array) -> tuple[Float64Array, BoolArray]:
        """(comparisons, blocks) a replicate's mean difference, NaN where it has none; and where it should have one."""
        means, present = self.cells.means(values), self.cells.present()
        gaps = means[self.level] - means[self.reference]
        expected = present[self.level] & present[self.reference]
        shape = (len(self.keys), gaps.shape[1])
        sums, counts, wanted = np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.bool_)
        np.add.at(sums, self.group, np.nan_to_num(gaps, nan=0.0))
        np.add.at(counts, self.group, ~np.isnan(gaps))
        np.logical_or.at(wanted, self.group, expected)
        return np.divide(sums, counts, out=np.full(shape, np.nan), where=counts > 0), wanted


def _frame(metric: Metric, units: Float64Array, wanted: BoolArray, tests: Float64Array) -> pl.DataFrame:
    defined, (p, p_corrected, *ends) = ~np.isnan(units), tests
    # Two shares differ by 1 at most.
    widest = 1.0 if metric.unit == "%" else np.inf
    low, high = (np.where(np.isinf(end), np.nan, np.clip(end, -widest, widest)) for end in ends)
    return pl.DataFrame(
        {
            "metric": pl.Series([metric.name] * len(units), dtype=pl.String),
            "pairs": pl.Series(defined.sum(axis=1), dtype=pl.Int64),
            "undefined": pl.Series((wanted & ~defined).sum(axis=1), dtype=pl.Int64),
            "mean": nullable(centres(units)),
            "low": nullable(low),
            "high": nullable(high),
            "p": nullable(p),
            "p_corrected": nullable(p_corrected),
            "dz": nullable([_dz(row[here]) for row, here in zip(units, defined, strict=True)]),
        }
    )


def _dz(gaps: Float64Array) -> float:
    """Cohen's d of paired differences; NaN where they do not vary beyond rounding."""
    if len(gaps) < 2:
        return np.nan
    sd = float(gaps.std(ddof=1))
    return float(gaps.mean()) / sd if sd > 1e-12 * np.abs(gaps).max() else np.nan
