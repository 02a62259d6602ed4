"""Tables of a study's answer: the proposed options, all options, and the differences between levels."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import polars as pl

from pavetwin.experiments.advice import Advice
from pavetwin.experiments.metrics import BATTERIES, COMPARED, ERROR_METRICS, INDEX_ERROR, metric_named
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.statistics import Comparison, Recommendation
from pavetwin.experiments.statistics.cells import levels_of, varied_columns
from pavetwin.experiments.statistics.paired import is_significant
from pavetwin.experiments.statistics.recommend import batteries_to_bring
from pavetwin.experiments.statistics.simultaneous import ALPHA
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.words import (
    factor_text,
    factors_text,
    heading,
    level_text,
    option_text,
    shown,
    subject,
)
from pavetwin.reports.blocks import Block, Section, Table, TableCell, text_cells
from pavetwin.reports.words import MISSING, counted, listed, p_text, percent

ANSWER: Final = "answer"
"""Anchor of the section with the proposal."""

FINDINGS: Final = "findings"
"""Anchor of the section with the differences."""

_MOST_ROWS: Final = 40  # A longer table of differences lists only those with a significant one


def answer_section(study: Study) -> Section:
    """The proposed option for each traffic, and every option with its means and probabilities."""
    blocks: list[Block] = []
    if study.advice and (study.advice_in or len(study.advice) > 1):
        blocks.append(_proposals(study))
    for advice in study.advice:
        recommendation = advice.recommendation
        if recommendation.options.height > 1 and recommendation.is_measured:
            of = f" ({advice.assumption.rstrip('.')})" if advice.assumption else ""
            blocks.append(options_table(recommendation, f"All options{of}{_averaged(study, recommendation)}"))
    return Section(ANSWER, "", blocks)


def _proposals(study: Study) -> Table:
    """A row for each traffic and each assumption."""
    parts: list[tuple[str, Sequence[Advice]]] = [("all", study.advice), *study.advice_in.items()]
    assumed = any(advice.assumption for advice in study.advice)
    rows = tuple(
        text_cells(name, *([advice.assumption.rstrip(".")] if assumed else []), *_proposal_row(advice))
        for name, each in parts
        for advice in each
    )
    lead = ("Traffic", "Sensor and preset") if assumed else ("Traffic",)
    heads = ("Fly", "Coverage (%)", "Time (s)", "Energy (%)", "Next option")
    return Table(
        "The proposed option in each traffic",
        (*lead, *heads, "Lead", "p", "Best with"),
        rows,
        lead=len(lead) + 1,
        notes=(
            "In brackets: 95 % intervals. Lead: the difference to the next option in what decides; its p is taken in "
            "pairs and not corrected. Best with: the probability that the option is the best of those that keep the "
            "limits, or level with it.",
        ),
        merged=False,
    )


def _proposal_row(advice: Advice) -> Iterator[str]:
    found = advice.recommendation
    best, other = found.best, found.next_option
    if best is None:
        yield from (f"none ({advice.sentences[0]})", *[MISSING] * 7)
        return
    yield option_text(best, found.by)
    yield from (_mean_interval(best, name) for name in COMPARED)
    yield MISSING if other is None else option_text(other, found.by)
    yield found.lead() or MISSING
    yield MISSING if other is None else p_text(other["p"])
    yield MISSING if best["certainty"] is None else percent(best["certainty"])


def options_table(found: Recommendation, caption: str = "All options") -> Table:
    """Every option, best first: its means, these corrected for the choice, and its probabilities."""
    columns = found.options.columns
    extra = [metric for metric in (*ERROR_METRICS, metric_named(INDEX_ERROR)) if metric.name in columns]
    has_tours, has_limits = BATTERIES in columns, bool(found.limits.named)
    heads = (
        *map(factor_text, found.by),
        *("Coverage (%)", "Corrected (%)", "Time (s)", "95th percentile (s)", "Energy (%)"),
        *(("Batteries to bring",) if has_tours else ()),
        *map(heading, extra),
        *(("Keeps limits",) if has_limits else ()),
        *("p", "Best with"),
    )
    rows: list[tuple[TableCell, ...]] = []
    remarks = [_remark(row) for row in found.options.iter_rows(named=True)]
    for row in found.options.iter_rows(named=True):
        rows.append(
            text_cells(
                *(level_text(name, row[name]) for name in found.by),
                _mean_interval(row, "coverage"),
                shown(metric_named("coverage"), row["coverage_expected"]),
                _mean_interval(row, "time_s"),
                shown(metric_named("time_s"), row["time_s_p95"]),
                _mean_interval(row, "energy"),
                *([MISSING if row[BATTERIES] is None else f"{batteries_to_bring(row)}"] if has_tours else []),
                *(shown(metric, row[metric.name]) for metric in extra),
                *([_keeps(row)] if has_limits else []),
                p_text(row["p"] if rows else None),
                MISSING if row["certainty"] is None else percent(row["certainty"]),
                *(remarks[len(rows) :][:1] if any(remarks) else []),
            )
        )
    heads += ("Remark",) if any(remarks) else ()
    notes = (
        *_rests_on(found.options),
        f"In brackets: 95 % intervals. Corrected: the mean without the advantage of being chosen. p: against the first "
        f"option in what decides, in pairs, not corrected. Means are per {found.unit}.",
    )
    opened_by = f"All {found.options.height} options"
    return Table(caption, heads, tuple(rows), lead=len(found.by), notes=notes, merged=False, opened_by=opened_by)


def _mean_interval(row: dict[str, Any], name: str) -> str:
    metric, low, high = metric_named(name), row[f"{name}_low"], row[f"{name}_high"]
    return shown(metric, row[name]) + (f" ({shown(metric, low)}–{shown(metric, high)})" if low is not None else "")


def _keeps(row: dict[str, Any]) -> str:
    """`yes (97 %)`: by the means, and the probability that the true means do."""
    sure = "" if row["kept"] is None else f" ({percent(row['kept'])})"
    return ("yes" if row["feasible"] else "no") + sure


def _remark(row: dict[str, Any]) -> str:
    remarks = (
        (row["failed_alone"], f"{row['failed_alone']} failed that others flew: left out"),
        (row["failed"] and not row["failed_alone"], f"{row['failed']} failed"),
        (row["undefined"], f"{row['undefined']} without defects"),
        (row["unmeasured"], f"index measured in {row['replicates']} replicates: left out"),
    )
    return "; ".join(text for applies, text in remarks if applies)


def _rests_on(options: pl.DataFrame) -> list[str]:
    """Defects and replicates under the coverages."""
    counts = options["defects"].drop_nulls().unique().sort().to_list()
    if not counts:
        return []
    ends = " to ".join(f"{count}" for count in dict.fromkeys((counts[0], counts[-1])))
    replicates = max(options["coverage_replicates"].to_list())
    return [f"Each coverage rests on {ends} defects in {replicates} replicates."]


def _averaged(study: Study, found: Recommendation) -> str:
    """The other varied factors, over which the means are taken."""
    names = [name for name in varied_columns(study.table) if name not in found.by and name not in ("sensor", "preset")]
    levels = {name: levels_of(study.table, name) for name in names}
    named = [
        f"{factor_text(name).lower()} ({listed([level_text(name, level) for level in found])})"
        for name, found in levels.items()
        if len(found) > 1
    ]
    return f", averaged over {listed(named)}" if named else ""


def findings_section(study: Study) -> Section:
    """Where levels differ significantly, by how much, and what the other settings leave possible."""
    rows = [row for found in study.comparisons for row in _findings(found)]
    shown_rows = rows if len(rows) <= _MOST_ROWS else [row for row in rows if row[2] != MISSING]
    if not shown_rows:
        return Section(FINDINGS, "Findings", [])
    families = {found.factor: found.number for found in study.comparisons}
    corrected = [f"{counted(number, 'comparison')} of {factors_text(name)}" for name, number in families.items()]
    notes = [
        f"Significant: p < {ALPHA:g}, corrected together for {listed(corrected)}. The last column gives the limits of "
        "the intervals of all other settings: larger differences are excluded there.",
        *(f"Compared with {subject(each.factor, each.reference)}: {each.reason}." for each in _reasoned(study)),
        *_few(study),
    ]
    heads = ("Compared", "Metric", "Significant in", "Mean difference there", "Smallest p", "Elsewhere within")
    table = Table(
        "Paired differences over all settings",
        heads,
        tuple(text_cells(*row) for row in shown_rows),
        lead=2,
        notes=notes,
    )
    return Section(FINDINGS, "Findings", [table])


def _findings(found: Comparison) -> Iterator[tuple[str, ...]]:
    """A row for each level and metric: settings with a difference, its range, and the range that others leave open."""
    reference = subject(found.factor, found.reference)
    tested = found.differences.filter(pl.col("p").is_not_null())
    for level in tested[found.factor].unique(maintain_order=True).to_list():
        for name in COMPARED:
            metric = metric_named(name)
            rows = tested.filter(pl.col(found.factor) == level, metric=name).to_dicts()
            if not rows:
                continue
            clear = [row for row in rows if is_significant(row)]
            means = sorted(row["mean"] for row in clear)
            others = [row for row in rows if not is_significant(row)]
            unit = {"%": "percentage points", "% of a battery": "% of a battery"}.get(metric.unit, metric.unit)
            yield (
                f"{subject(found.factor, level)} − {reference}",
                f"{metric.label} ({unit})",
                f"{len(clear)} of {len(rows)}" if clear else MISSING,
                " to ".join(dict.fromkeys(shown(metric, mean) for mean in (means[0], means[-1]))) if clear else MISSING,
                p_text(min((row["p_corrected"] for row in clear), default=None)),
                _open_range(name, others),
            )


def _open_range(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """The differences that the intervals of rows leave possible."""
    if not rows:
        return MISSING
    if any(row["low"] is None for row in rows):
        return "unknown"
    metric = metric_named(name)
    return f"{shown(metric, min(row['low'] for row in rows))} to {shown(metric, max(row['high'] for row in rows))}"


def _reasoned(study: Study) -> list[Comparison]:
    return [found for found in study.comparisons if found.reason]


def _few(study: Study) -> list[str]:
    """A warning about intervals of few replicates."""
    most = study.summary.filter(metric="coverage")["n"].max()
    if not isinstance(most, int) or not 2 <= most < _ENOUGH:
        return []
    unsure = " Fewer than 6 exclude nothing." if most <= FEW else ""
    return [f"Intervals of {most} replicates are rough: they miss the true mean more often than stated.{unsure}"]


_ENOUGH: Final = 10  # Replicates from which on intervals hold about what they promise
