"""The findings of a study as sentences that claim no more than the intervals and tests show."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.experiments.metrics import COMPARED, METRICS, REPLICATE, metric_named
from pavetwin.experiments.statistics.cells import levels_of
from pavetwin.experiments.statistics.effects import RESIDUAL, TIMES
from pavetwin.experiments.statistics.paired import Comparison, holm, is_significant
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.words import among, amount, difference, factor_name, setting, span, subject
from pavetwin.reports.words import listed, nonzero, opened, percent, probability

EFFECT_ALPHA: Final = 0.01
"""Family-wise error of the factors that are named: small, since it adds to that of the differences."""

ENOUGH: Final = 10
"""Replicates from which on intervals hold about what they promise."""

_TAIL_OF, _TAIL_TIMES, _TAIL_S = 10, 3.0, 60.0
"""A heavy tail: so many missions with a 95th percentile so many times, and so many seconds above, their median."""

_MAIN: Final = METRICS[0].name
_MOST = {_MAIN: 3, "time_s": 3, "energy": 1}
"""Sentences on shown differences of each metric."""
_MOST_OF_OTHERS = {_MAIN: 1, "time_s": 1}
"""The same where something else than policies is compared."""

Row = dict[str, Any]


def conclusions(
    summary: pl.DataFrame, comparisons: Sequence[Comparison], effects: pl.DataFrame, *, tours: bool = False
) -> list[str]:
    """At most a dozen sentences, and four for each comparison after the first: coverage first, then time and energy,
    tails, what explains most, what is missing.

    A difference is claimed where its corrected p is below 0.05, that is where its interval excludes 0, and with the
    numbers of the table of differences. Of every other comparison the text says that no difference could be shown, and
    what the same intervals leave possible.

    Args:
        summary, effects: of the same table, as the functions of these names make them.
        comparisons: the first is what the study is about.
        tours: of a table with one row a mission.
    """
    claims = [_Claims(comparison, _MOST_OF_OTHERS if at else _MOST) for at, comparison in enumerate(comparisons)]
    return [
        *(sentence for claim in claims for sentence in claim.sentences()),
        *_few(summary),
        *_tail(summary, "wait_s", "waiting"),
        *(_tail(summary, "time_s", "time") if "wait_s" not in summary["metric"] else []),
        *_explained(effects, tours=tours),
        *_missing(summary),
    ]


class _Claims:
    """The sentences about the comparisons of one family."""

    def __init__(self, comparison: Comparison, most: Mapping[str, int]) -> None:
        self.factor, self.level = comparison.factor, comparison.reference
        self.reference = subject(self.factor, self.level)
        self.reason, self.number, self.most = comparison.reason, comparison.number, most
        differences = comparison.differences
        columns = differences.columns[: differences.columns.index("metric")]
        self.others = _varied(differences, [column for column in columns if column != self.factor])
        self.rows = differences.drop_nulls("p").filter(pl.col("metric").is_in(COMPARED)).to_dicts()

    def sentences(self) -> list[str]:
        if not self.rows:
            return [
                f"Nothing could be compared with {self.reference}: that takes missions of it and of another in the "
                "same two replicates."
            ]
        shown = self.shown("time_s")
        if "energy" in self.most:
            shown += self.shown("energy", unless="time_s")
        found = [*self.shown(_MAIN), *self.not_shown(_MAIN), *shown, *self.not_shown("time_s")]
        return [*self.against(), *found, *self.corrected()]

    def against(self) -> list[str]:
        """What is compared with what, where that was not to be expected."""
        if not self.reason:
            return []
        levels = [subject(self.factor, level) for level in _grouped(self.rows, self._level)]
        verb = "is" if len(levels) == 1 else "are"
        return [opened(f"compared with {self.reference}, {self.reason}, {verb} {listed(levels)}")]

    def shown(self, name: str, unless: str | None = None) -> list[str]:
        """A sentence for each level and direction, the largest difference in full.

        Args:
            unless: a metric; levels of which it was shown in that direction are left out.
        """

        def aim(row: Row) -> tuple[Any, bool]:
            return row[self.factor], row["mean"] > 0

        claimed = [row for row in self.rows if is_significant(row)]
        known = {aim(row) for row in claimed if row["metric"] == unless}
        groups = _grouped([row for row in claimed if row["metric"] == name and aim(row) not in known], aim).values()
        ordered = sorted(groups, key=lambda group: -max(abs(row["mean"]) for row in group))
        sentences = [self._difference(name, group) for group in ordered[: self.most[name]]]
        if sentences and (more := len(ordered) - len(sentences)):
            sentences[-1] += f" The table of differences has {more} more."
        return sentences

    def _difference(self, name: str, group: Sequence[Row]) -> str:
        metric = metric_named(name)
        largest, *rest = sorted(group, key=lambda row: -abs(row["mean"]))
        side = "higher" if largest["mean"] > 0 else "lower"
        low, high = sorted((abs(largest["low"]), abs(largest["high"])))
        settings = sum(row["metric"] == name and self._level(row) == self._level(largest) for row in self.rows)
        gap = f"{difference(metric, abs(largest['mean']))} {side}"
        levels = f"{among(self.factor, largest[self.factor])} than {among(self.factor, self.level)}"
        evidence = f"(95 % interval {span(metric, low, high)}, {probability(largest['p_corrected'])})"
        text = f"{setting(largest, self.others)}, {metric.label.lower()} is {gap} {levels} {evidence}"
        if rest:
            least = f"{nonzero(abs(rest[-1]['mean']) * metric.scale, metric.digits)} to " if len(rest) > 1 else ""
            size = difference(metric, abs(rest[0]["mean"]))
            text += f"; in {len(rest)} more of the {settings} settings it is {least}{size} {side}"
        return opened(text)

    def not_shown(self, name: str) -> list[str]:
        """One sentence on all comparisons of a metric that showed nothing, with what their intervals leave possible."""
        every = [row for row in self.rows if row["metric"] == name]
        silent = [row for row in every if not is_significant(row)]
        if not silent:
            return []
        settings = {level: len(rows) for level, rows in _grouped(every, self._level).items()}
        levels: dict[str, list[str]] = {}
        for level, rows in _grouped(silent, self._level).items():
            levels.setdefault(_out_of(len(rows), settings[level]), []).append(subject(self.factor, level))
        whom = listed([listed(names) + where for where, names in levels.items()])
        what = metric_named(name).label.lower()
        text = f"no difference in {what} from {self.reference} could be shown for {whom}"
        return [opened(f"{text}; {_not_excluded(name, silent)}")]

    def _level(self, row: Row) -> Any:
        return row[self.factor]

    def corrected(self) -> list[str]:
        """For how many comparisons; or that so few replicates could pass no test after correction."""
        if all(row["low"] is None for row in self.rows):
            pairs = max(row["pairs"] for row in self.rows)
            return [
                f"With {pairs} replicates no difference from {self.reference}, however large, could be told from "
                "chance: fly at least 6, better 20."
            ]
        if not any(is_significant(row) for row in self.rows):
            return []
        count = f"{self.number} comparison{'s' if self.number > 1 else ''}"
        return [f"Intervals and p of differences from {self.reference} are corrected for {count}."]


def _not_excluded(name: str, rows: Sequence[Row]) -> str:
    """What the intervals of these comparisons leave possible."""
    metric = metric_named(name)
    if any(row["low"] is None for row in rows):
        return "with so few pairs a difference cannot be excluded there"
    low, high = min(row["low"] for row in rows), max(row["high"] for row in rows)
    if low == high == 0:
        return "all pairs are equal there"
    unit = "percentage points" if metric.unit == "%" else metric.unit
    return f"differences of {span(metric, low, high)} {unit} are not excluded there"


def _grouped(rows: Sequence[Row], key: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    """Rows by a key, in order of its first appearance."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups


def _varied(frame: pl.DataFrame, columns: Sequence[str]) -> list[str]:
    """The columns with more than one level; naming the others would add nothing."""
    return [column for column in columns if len(levels_of(frame, column)) > 1]


def _out_of(found: int, settings: int) -> str:
    if settings == 1:
        return ""
    return f" in any of the {settings} settings" if found == settings else f" in {found} of {settings} settings"


def _tail(summary: pl.DataFrame, name: str, what: str) -> list[str]:
    """The cell whose rare missions take longest against its usual one, where that is far longer."""
    columns = _varied(summary, summary.columns[: summary.columns.index("metric")])
    rows = summary.filter(metric=name).drop_nulls(["median", "p95"]).to_dicts()
    heavy = [
        row
        for row in rows
        if row["n"] >= _TAIL_OF and row["p95"] >= max(_TAIL_TIMES * row["median"], row["median"] + _TAIL_S)
    ]
    if not heavy:
        return []
    worst = max(heavy, key=lambda row: row["p95"] - row["median"])
    median, rare, longest = (amount(metric_named(name), worst[column]) for column in ("median", "p95", "maximum"))
    # The 95th percentile of fewer than twenty missions is close to their maximum.
    few = worst["n"] < 20
    tail = "" if few else f"one mission in twenty had over {rare} and "
    of = f"{worst['n']} missions" if few else f"{worst['n']}"
    where = setting(worst, columns)
    return [
        opened(f"{what} has a heavy tail: {where} its median was {median}, but {tail}the longest of {of} had {longest}")
    ]


def _explained(effects: pl.DataFrame, *, tours: bool) -> list[str]:
    """How the variance of the main metric falls to replicates and factors; a factor is named where its test allows."""
    rows = effects.filter(pl.col("replicates") > 1, metric=_MAIN).drop_nulls("eta2").to_dicts()
    if not rows:
        return []
    p = holm(np.array([np.nan if row["p"] is None else row["p"] for row in rows]))
    named = [row for row, value in zip(rows, p, strict=True) if value < EFFECT_ALPHA and row["eta2"] >= 0.005]
    named.sort(key=lambda row: -row["eta2"])
    share = {row["term"]: row["eta2"] for row in rows}
    between = "replicates" if tours else "segments (replicates)"
    parts = [f"{percent(share[REPLICATE])} lies between {between}"] if share.get(REPLICATE) else []
    parts += [f"{percent(row['eta2'])} is explained by {_term(row['term'])}" for row in named[:3]]
    if not named:
        parts.append("none could be shown to be explained by a factor")
    rest = f" ({percent(share[RESIDUAL])} by nothing in this analysis)" if share.get(RESIDUAL, 0) >= 0.005 else ""
    tested = int((~np.isnan(p)).sum())
    return [opened(f"of the variance in {metric_named(_MAIN).label.lower()}, {listed(parts)}{rest}")] + (
        [f"A factor is named where it holds at {100 * EFFECT_ALPHA:g} % after Holm's correction for {tested} terms."]
        if tested
        else []
    )


def _term(name: str) -> str:
    factors = [factor_name(column) for column in name.split(TIMES)]
    return f"how {listed(factors)} act together" if len(factors) > 1 else factors[0]


def _few(summary: pl.DataFrame) -> list[str]:
    """That intervals of small samples are rough: what simulations showed stands in `bootstrap`."""
    most = summary.filter(metric=_MAIN)["n"].max()
    if not isinstance(most, int) or not 2 <= most < ENOUGH:
        return []
    return [
        f"Intervals of {most} replicates are rough: they miss the truth more often than they say"
        + (", and so few do not say how sure a mean is." if most < FEW else ".")
    ]


def _missing(summary: pl.DataFrame) -> list[str]:
    rows = summary.filter(metric=_MAIN)
    missions = int(rows.select(pl.sum_horizontal("n", "undefined", "failed").sum()).item())
    failed, undefined = int(rows["failed"].sum()), int(rows["undefined"].sum())
    parts = [f"{failed} of {missions} missions failed"] * bool(failed)
    parts += [f"{undefined} of {missions} missions had no defects to find"] * bool(undefined)
    mean = f"mean {metric_named(_MAIN).label.lower()}"
    return [opened(f"{listed(parts)}; they are in no {mean}, neither as 0 nor as 100 %")] if parts else []
