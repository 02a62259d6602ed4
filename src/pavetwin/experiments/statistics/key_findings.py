"""The few findings that a decision rests on: one plain sentence for each comparison that matters most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from pavetwin.experiments.metrics import Metric, metric_named
from pavetwin.experiments.statistics.paired import Comparison, is_significant
from pavetwin.experiments.words import among, factors_text, level_text, setting
from pavetwin.reports.words import listed, nonzero, opened

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


@dataclass(frozen=True)
class _Claim:
    """That a level differs from a reference in one direction."""

    comparison: Comparison
    level: Any
    side: int
    shown: list[Row]
    """The settings in which it was shown."""
    settings: list[Row]
    """All in which it was tested."""


def _sentence(compared: Sequence[Comparison], metric: Metric) -> str:
    factor, number = compared[0].factor, compared[0].number
    claims: list[_Claim] = []
    settings = 0
    for comparison in compared:
        rows = comparison.differences.filter(pl.col("p").is_not_null(), metric=metric.name).to_dicts()
        settings += len(rows)
        for level in dict.fromkeys(row[factor] for row in rows):
            of_level = [row for row in rows if row[factor] == level]
            for side in (1, -1):
                shown = [row for row in of_level if is_significant(row) and side * row["mean"] > 0]
                claims += [_Claim(comparison, level, side, shown, of_level)] if shown else []
    if not settings:
        return ""
    references = listed([level_text(factor, comparison.reference) for comparison in compared])
    whom = f"between {factors_text(factor)}" if len(compared) > 1 else f"from {references}"
    family = f"corrected for {number} comparison{'s' if number > 1 else ''}"
    if not claims:
        return opened(f"no difference in {metric.label.lower()} {whom} could be shown ({family})")
    traffic = _only_traffic(compared, [row for claim in claims for row in claim.shown])
    clauses = [
        _clause(metric, claim, follows=bool(at) and _aim(claims[at - 1]) == _aim(claim), traffic=traffic)
        for at, claim in enumerate(claims)
    ]
    more = len(clauses) - _MOST_CLAUSES
    rest = f"; {more} more in the tables of differences" if more > 0 else ""
    where = f"in {traffic} traffic, " if traffic else ""
    silent = "; no other difference could be shown" if sum(len(claim.shown) for claim in claims) < settings else ""
    text = f"{where}{metric.label.lower()} is {'; '.join(clauses[:_MOST_CLAUSES])}{rest}{silent}"
    return f"{opened(text)} Each: p < 0.05, {family}."


def _aim(claim: _Claim) -> tuple[Any, int]:
    return claim.comparison.reference, claim.side


def _clause(metric: Metric, claim: _Claim, *, follows: bool, traffic: str) -> str:
    """`4.9 to 5.2 percentage points higher with hover than with baseline (2 of 9 settings)`; one that follows another
    like it, `7.7 with micro (at 10 m)`.

    Args:
        traffic: the only one in which anything was shown, which the sentence names; empty otherwise.
    """
    factor = claim.comparison.factor
    sizes = sorted(abs(row["mean"]) * metric.scale for row in claim.shown)
    ends = list(dict.fromkeys(nonzero(size, metric.digits) for size in (sizes[0], sizes[-1])))
    unit = "percentage points" if metric.unit == "%" else metric.unit
    side = "higher" if claim.side > 0 else "lower"
    level = among(factor, claim.level)
    tested = [row for row in claim.settings if not traffic or row["traffic"] == traffic]
    where = _where(claim, tested, follows=follows)
    if follows:
        return f"{' to '.join(ends)} {level}{where}"
    return f"{' to '.join(ends)} {unit} {side} {level} than {among(factor, claim.comparison.reference)}{where}"


def _where(claim: _Claim, tested: Sequence[Row], *, follows: bool) -> str:
    """The setting in brackets where it is one of several, else how many of them; nothing where there is only one."""
    if len(claim.shown) == 1 and len(tested) > 1:
        columns = claim.comparison.differences.columns
        varied = [
            name
            for name in columns[: columns.index("metric")]
            if name != claim.comparison.factor and len({row[name] for row in tested}) > 1
        ]
        return f" ({setting(claim.shown[0], varied)})"
    return f" ({len(claim.shown)} of {len(tested)}{'' if follows else ' settings'})" if len(tested) > 1 else ""


def _only_traffic(compared: Sequence[Comparison], shown: Sequence[Row]) -> str:
    """The one of several densities in which all was shown; empty where it was in more."""
    densities = {row["traffic"] for comparison in compared for row in comparison.differences.to_dicts()}
    only = {row["traffic"] for row in shown}
    return str(only.pop()) if len(densities) > 1 and len(only) == 1 else ""
