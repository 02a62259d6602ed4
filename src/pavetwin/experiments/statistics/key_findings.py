"""The few findings that a decision rests on: one plain sentence for each comparison that matters most."""

from collections.abc import Sequence
from typing import Any, Final

import polars as pl

from pavetwin.experiments.metrics import Metric, metric_named
from pavetwin.experiments.statistics.paired import Comparison, is_significant
from pavetwin.experiments.words import among, factors_text, level_text, listed, nonzero, opened

MOST: Final = 3
_FIRST: Final = (("altitude_m", "coverage"), ("policy", "coverage"), ("policy", "time_s"), ("altitude_m", "time_s"))
"""Factor and metric, what decides most first; swept settings follow."""
_MOST_CLAUSES: Final = 4

Row = dict[str, Any]


def key_findings(comparisons: Sequence[Comparison]) -> list[str]:
    """At most three sentences, each on one metric over the levels of one factor.

    What is claimed has a corrected p below 0.05; the sizes are the smallest and the largest mean difference of the
    settings in which it was shown.
    """
    swept = [found.factor for found in comparisons if found.factor not in ("policy", "altitude_m")]
    wanted = [*_FIRST, *((factor, "coverage") for factor in dict.fromkeys(swept))]
    found = []
    for factor, metric in wanted:
        compared = [comparison for comparison in comparisons if comparison.factor == factor]
        sentence = _sentence(compared, metric_named(metric)) if compared else ""
        found += [sentence] if sentence else []
    return found[:MOST]


def _sentence(compared: Sequence[Comparison], metric: Metric) -> str:
    factor, number = compared[0].factor, compared[0].number
    clauses: list[str] = []
    shown: list[Row] = []
    settings, before = 0, None
    for comparison in compared:
        rows = comparison.differences.filter(pl.col("p").is_not_null(), metric=metric.name).to_dicts()
        settings += len(rows)
        for level in dict.fromkeys(row[factor] for row in rows):
            of_level = [row for row in rows if row[factor] == level]
            for side in (1, -1):
                claimed = [row for row in of_level if is_significant(row) and side * row["mean"] > 0]
                if claimed:
                    same = (comparison.reference, side)
                    than = "" if same == before else among(factor, comparison.reference)
                    clauses.append(_clause(metric, among(factor, level), than, claimed, len(of_level)))
                    shown, before = shown + claimed, same
    if not settings:
        return ""
    references = listed([level_text(factor, comparison.reference) for comparison in compared])
    whom = f"between {factors_text(factor)}" if len(compared) > 1 else f"from {references}"
    family = f"corrected for {number} comparison{'s' if number > 1 else ''}"
    if not shown:
        return opened(f"no difference in {metric.label.lower()} {whom} could be shown ({family})")
    more = len(clauses) - _MOST_CLAUSES
    rest = f"; {more} more in the tables of differences" if more > 0 else ""
    where = _where(compared, shown)
    silent = "; no other difference could be shown" if len(shown) < settings else ""
    text = f"{where}{metric.label.lower()} is {'; '.join(clauses[:_MOST_CLAUSES])}{rest}{silent}"
    return f"{opened(text)} Each: p < 0.05, {family}."


def _clause(metric: Metric, level: str, than: str, claimed: Sequence[Row], settings: int) -> str:
    """`4.9 to 5.2 percentage points higher with hover than with baseline (2 of 9 settings)`; the next one like it, of
    which `than` is empty, `7.7 with micro (1 of 9)`."""
    sizes = sorted(abs(row["mean"]) * metric.scale for row in claimed)
    ends = list(dict.fromkeys(nonzero(size, metric.digits) for size in (sizes[0], sizes[-1])))
    unit = "percentage points" if metric.unit == "%" else metric.unit
    side = "higher" if claimed[0]["mean"] > 0 else "lower"
    if not than:
        return f"{' to '.join(ends)} {level} ({len(claimed)} of {settings})"
    return f"{' to '.join(ends)} {unit} {side} {level} than {than} ({len(claimed)} of {settings} settings)"


def _where(compared: Sequence[Comparison], shown: Sequence[Row]) -> str:
    """`In high traffic, ` where all that was shown was in one of several densities."""
    densities = {row["traffic"] for comparison in compared for row in comparison.differences.to_dicts()}
    only = {row["traffic"] for row in shown}
    return f"in {only.pop()} traffic, " if len(densities) > 1 and len(only) == 1 else ""
