"""What a study shows, in sentences that say no more than their intervals and tests do."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from pavetwin.experiments.metrics import METRICS, REFERENCE, REPLICATE, metric_named
from pavetwin.experiments.statistics.effects import RESIDUAL, TIMES
from pavetwin.experiments.statistics.paired import FLIPS, holm
from pavetwin.experiments.statistics.wording import (
    amount,
    compared,
    difference,
    factor_name,
    listed,
    number,
    opened,
    percent,
    probability,
    setting,
    span,
    subject,
)

ALPHA: Final = 0.05
"""Family-wise error of all differences that are spoken of."""
EFFECT_ALPHA: Final = 0.01
"""The same of the factors that are named: small, since it adds to the other."""

ENOUGH: Final = 10
"""Replicates from which on intervals hold about what they promise."""

_MAIN: Final = METRICS[0].name
_SPOKEN: Final = (_MAIN, "time_s", "energy")
_MOST = {_MAIN: 3, "time_s": 3, "energy": 1}
"""Sentences on shown differences of each metric."""

Row = dict[str, Any]


def conclusions(
    summary: pl.DataFrame,
    differences: pl.DataFrame,
    effects: pl.DataFrame,
    *,
    factor: str = "policy",
    reference: Any = REFERENCE,
) -> list[str]:
    """At most a dozen sentences: coverage first, then time and energy, tails, what explains most, what is missing.

    A difference is claimed where its interval excludes 0 and its p is below 0.05 after Holm's correction over *all*
    comparisons of coverage, time and energy together; `p_corrected` is each metric's own and may be smaller. Of every
    other comparison the text says that no difference could be shown, and what the intervals leave possible.

    Args:
        summary, differences, effects: of the same table, as the functions of these names make them.
        factor, reference: what `differences` compares.
    """
    claims = _Claims(differences, factor, reference)
    return [
        *claims.shown(_MAIN),
        *claims.not_shown(_MAIN),
        *claims.shown("time_s"),
        *claims.shown("energy", unless="time_s"),
        *claims.not_shown("time_s"),
        *claims.hopeless(),
        *_few(summary),
        *_tail(summary, "wait_s", "waiting"),
        *(_tail(summary, "time_s", "time") if "wait_s" not in summary["metric"] else []),
        *_explained(effects),
        *_missing(summary),
    ]


class _Claims:
    """The comparisons that may be spoken of, corrected together."""

    def __init__(self, differences: pl.DataFrame, factor: str, reference: Any) -> None:
        self.factor, self.reference = factor, subject(factor, reference)
        columns = differences.columns[: differences.columns.index("metric")]
        self.others = _varied(differences, [column for column in columns if column != factor])
        spoken = differences.filter(pl.col("metric").is_in(_SPOKEN))
        p = holm(np.array(spoken["p"].fill_null(float("nan")).to_numpy(), dtype=np.float64))
        rows = spoken.to_dicts()
        self.family = int((~np.isnan(p)).sum())
        self.rows = [row | {"family_p": value} for row, value in zip(rows, p, strict=True) if not np.isnan(value)]
        self.noted = False

    def shown(self, name: str, unless: str | None = None) -> list[str]:
        """A sentence for each level and direction, the largest difference in full.

        Args:
            unless: a metric; levels of which it was shown in that direction are left out.
        """

        def aim(row: Row) -> tuple[Any, bool]:
            return row[self.factor], row["mean"] > 0

        claimed = [row for row in self.rows if _claimed(row)]
        known = {aim(row) for row in claimed if row["metric"] == unless}
        groups = _grouped([row for row in claimed if row["metric"] == name and aim(row) not in known], aim)
        groups.sort(key=lambda group: -max(abs(row["mean"]) for row in group))
        sentences = [self._difference(name, group) for group in groups[: _MOST[name]]]
        if more := len(groups) - len(sentences):
            sentences[-1] += f" The table of differences has {more} more."
        return sentences

    def _difference(self, name: str, group: Sequence[Row]) -> str:
        largest = max(group, key=lambda row: abs(row["mean"]))
        what = [compared(name, largest["mean"], self.reference) + self._evidence(largest)]
        for also in _SPOKEN[_SPOKEN.index(name) + 1 :]:
            same = self._in_cell_of(largest, also)
            if same is not None and _claimed(same):
                what.append(compared(also, same["mean"], "").removesuffix(" than") + self._evidence(same))
        text = f"{setting(largest, self.others)}, {subject(self.factor, largest[self.factor])} {listed(what)}"
        return opened(text + self._elsewhere(name, group, largest))

    def _elsewhere(self, name: str, group: Sequence[Row], largest: Row) -> str:
        rest = sorted(abs(row["mean"]) for row in group if row is not largest)
        if not rest:
            return ""
        metric = metric_named(name)
        settings = len([row for row in self.rows if _same(row, largest, ["metric", self.factor])])
        size = difference(metric, rest[-1])
        if len(rest) > 1:
            size = f"{number(rest[0] * metric.scale, metric.digits)} to {size}"
        return f"; in {len(rest)} more of the {settings} settings it does so by {size}"

    def _evidence(self, row: Row) -> str:
        low, high = sorted((abs(row["low"]), abs(row["high"])))
        note = "" if self.noted else f" after Holm's correction over {_comparisons(self.family)}"
        self.noted = True
        interval = span(metric_named(row["metric"]), low, high)
        return f" (95 % interval {interval}, {probability(row['family_p'])}{note})"

    def _in_cell_of(self, row: Row, name: str) -> Row | None:
        found = (
            other for other in self.rows if other["metric"] == name and _same(row, other, [self.factor, *self.others])
        )
        return next(found, None)

    def not_shown(self, name: str) -> list[str]:
        """One sentence on all comparisons of a metric that showed nothing, with what their intervals leave possible."""
        every = [row for row in self.rows if row["metric"] == name]
        silent = [row for row in every if not _claimed(row)]
        if not silent:
            return []
        whom = [
            listed([subject(self.factor, level) for level in levels]) + where
            for where, levels in self._silent_levels(every, silent).items()
        ]
        what = metric_named(name).label.lower()
        text = f"no difference in {what} from {self.reference} could be shown for {listed(whom)}"
        return [opened(f"{text}; {_not_excluded(name, silent)}")]

    def _silent_levels(self, every: Sequence[Row], silent: Sequence[Row]) -> dict[str, list[Any]]:
        """The levels by how many of their settings showed nothing."""
        levels: dict[str, list[Any]] = {}
        for group in _grouped(silent, lambda row: row[self.factor]):
            level = group[0][self.factor]
            settings = sum(row[self.factor] == level for row in every)
            levels.setdefault(_out_of(len(group), settings), []).append(level)
        return levels

    def hopeless(self) -> list[str]:
        """That even the clearest differences of so few replicates could pass no test after correction."""
        if not self.rows:
            return [
                f"Nothing could be compared with {self.reference}: that takes missions of it and of another in the "
                "same two replicates."
            ]
        pairs = max(row["pairs"] for row in self.rows)
        if max(2.0 ** (1 - pairs), 1 / (FLIPS + 1)) * self.family < ALPHA:
            return []
        return [
            f"With {pairs} replicates no difference, however large, could pass a test corrected for "
            f"{_comparisons(self.family)}: fly more replicates, or compare fewer settings."
        ]


def _not_excluded(name: str, rows: Sequence[Row]) -> str:
    metric = metric_named(name)
    low, high = min(row["low"] for row in rows), max(row["high"] for row in rows)
    if low == high == 0:
        return "all pairs are equal there"
    unit = "percentage points" if metric.unit == "%" else metric.unit
    return f"differences of {span(metric, low, high)} {unit} are not excluded there"


def _comparisons(number: int) -> str:
    return f"{number} comparison" + ("s" if number > 1 else "")


def _claimed(row: Row) -> bool:
    return bool(row["family_p"] < ALPHA and (row["low"] > 0 or row["high"] < 0))


def _same(row: Row, other: Row, columns: Sequence[str]) -> bool:
    return all(row[column] == other[column] for column in columns)


def _grouped(rows: Sequence[Row], key: Any) -> list[list[Row]]:
    """Rows that share a key, in order of its first appearance."""
    groups: dict[Any, list[Row]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return list(groups.values())


def _varied(frame: pl.DataFrame, columns: Sequence[str]) -> list[str]:
    """The columns with more than one level; to name the others would tell nothing."""
    return [column for column in columns if frame[column].n_unique() > 1]


def _out_of(found: int, settings: int) -> str:
    if settings == 1:
        return ""
    return f" in any of the {settings} settings" if found == settings else f" in {found} of {settings} settings"


def _tail(summary: pl.DataFrame, name: str, what: str) -> list[str]:
    """The cell whose rare missions take longest against its usual one, where that is at least twice as long."""
    columns = _varied(summary, summary.columns[: summary.columns.index("metric")])
    rows = summary.filter(metric=name).drop_nulls(["median", "p95"]).to_dicts()
    heavy = [row for row in rows if row["n"] >= 5 and row["p95"] > 2 * row["median"] and row["p95"] >= 1.0]
    if not heavy:
        return []
    worst, metric = max(heavy, key=lambda row: row["p95"] - row["median"]), metric_named(name)
    text = f"{what} has a heavy tail: {setting(worst, columns)} its median was {amount(metric, worst['median'])}, but"
    longest = amount(metric, worst["maximum"])
    # The 95th percentile of fewer than twenty missions is close to their maximum.
    if worst["n"] < 20:
        return [opened(f"{text} the longest of {worst['n']} missions had {longest}")]
    rare = amount(metric, worst["p95"])
    return [opened(f"{text} one mission in twenty had over {rare} and the longest of {worst['n']} had {longest}")]


def _explained(effects: pl.DataFrame) -> list[str]:
    """How the variance of the main metric falls to replicates and factors; a factor is named where its test allows."""
    rows = effects.filter(pl.col("replicates") > 1, metric=_MAIN).drop_nulls("eta2").to_dicts()
    if not rows:
        return []
    p = holm(np.array([np.nan if row["p"] is None else row["p"] for row in rows]))
    named = [row for row, value in zip(rows, p, strict=True) if value < EFFECT_ALPHA and row["eta2"] >= 0.005]
    named.sort(key=lambda row: -row["eta2"])
    share = {row["term"]: row["eta2"] for row in rows}
    parts = [f"{percent(share[REPLICATE])} lies between segments (replicates)"] if share.get(REPLICATE) else []
    parts += [f"{percent(row['eta2'])} is explained by {_term(row['term'])}" for row in named[:3]]
    if not named:
        parts.append("none could be shown to be explained by a factor")
    rest = f" ({percent(share[RESIDUAL])} by nothing in this analysis)" if share.get(RESIDUAL, 0) >= 0.005 else ""
    return [opened(f"of the variance in {metric_named(_MAIN).label.lower()}, {listed(parts)}{rest}")]


def _term(name: str) -> str:
    factors = [factor_name(column) for column in name.split(TIMES)]
    return f"how {listed(factors)} act together" if len(factors) > 1 else factors[0]


def _few(summary: pl.DataFrame) -> list[str]:
    """That intervals of small samples are rough: what simulations showed stands in `bootstrap`."""
    most = summary.filter(metric=_MAIN)["n"].max()
    if not isinstance(most, int) or not 2 <= most < ENOUGH:
        return []
    return [
        f"Intervals of {most} replicates are rough: they may miss the truth more often than they say, or reach where "
        "no value can be."
    ]


def _missing(summary: pl.DataFrame) -> list[str]:
    """Missions that no mean contains."""
    rows = summary.filter(metric=_MAIN)
    missions = int(rows.select(pl.sum_horizontal("n", "undefined", "failed").sum()).item())
    failed, undefined = int(rows["failed"].sum()), int(rows["undefined"].sum())
    parts = [f"{failed} of {missions} missions failed"] if failed else []
    if undefined:
        parts.append(f"in {undefined} of {missions} {metric_named(_MAIN).label.lower()} is undefined")
    return [opened(f"{listed(parts)}; they are in no mean, neither as 0 nor as 100 %")] if parts else []
