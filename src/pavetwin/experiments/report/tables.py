"""Tables of means and tails, and their files: tidy CSV, Markdown, LaTeX with booktabs."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
import polars as pl

from pavetwin.experiments.metrics import BATTERIES, DETECTED_METRICS, ERROR_METRICS, Metric, metric_named
from pavetwin.experiments.report.study import Group, Row, Study
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.words import factor_text, heading, level_text, shown
from pavetwin.reports.blocks import Table, TableCell, text_cells
from pavetwin.reports.words import MISSING, counted

HEADLINE: Final = (
    *("coverage", "swath_coverage", "recovery", "time_s", "energy", BATTERIES),
    *(metric.name for metric in (*ERROR_METRICS, *DETECTED_METRICS)),
)
FEW_MARK: Final = "†"
"""Mark of cells with too few values."""
TAILS: Final = ("time_s", "energy")
"""Metrics whose rare large values matter."""


def headline_tables(group: Group) -> Iterator[tuple[Metric, Table]]:
    """One for each headline metric that has a defined value in the group."""
    for name in HEADLINE:
        metric = metric_named(name)
        if any(row is not None and row["mean"] is not None for row in _rows(group, name)):
            yield metric, headline_table(group, metric)


def headline_table(group: Group, metric: Metric) -> Table:
    """Mean ± SD of every cell, and in brackets the number of defined values where that is not the usual one."""
    rows = [row for row in _rows(group, metric.name) if row is not None]
    usual = max((row["n"] for row in rows), default=0)
    lines = list(_lines(group, metric.name))
    body = tuple((*lead, *_cells(metric, cells, whole, usual)) for lead, cells, whole in lines)
    return Table(
        caption=_caption(f"{heading(metric)}: mean ± standard deviation", group),
        heads=_heads(group),
        rows=body,
        lead=len(_leading(group)),
        notes=[
            *_notes(rows, usual),
            *_rests_on(metric, rows),
            *_without(group),
            *_of_bold(body, partial=not all(each for _, _, whole in lines for each in whole)),
            *(_by_time(group) if metric.name == "energy" else []),
        ],
        span=factor_text("policy"),
    )


def tail_table(group: Group, metric: Metric) -> Table:
    """Median, 95th percentile and maximum of every cell."""
    body = tuple(
        (*lead, *text_cells(*(_tail(metric, cell) for cell in cells))) for lead, cells, _ in _lines(group, metric.name)
    )
    caption = f"{heading(metric)}: median / 95th percentile / maximum"
    lead = len(_leading(group))
    notes = _by_time(group) if metric.name == "energy" else []
    return Table(_caption(caption, group), _heads(group), body, lead=lead, notes=notes, span=factor_text("policy"))


def _by_time(group: Group) -> list[str]:
    """A note if every mission spent energy at one rate, as in the linear model: energy then adds nothing to time."""
    rates = group.result.filter(pl.col("time_s") > 0).select(rate=100 * pl.col("energy") / pl.col("time_s"))["rate"]
    known = rates.drop_nulls().to_numpy()
    if not len(known) or np.ptp(known) > 1e-6 * known.max():
        return []
    return [f"The battery falls evenly with time here: energy in % is time in s over {1 / known.mean():.4g}."]


def _lines(group: Group, metric: str) -> Iterator[tuple[list[TableCell], list[Row | None], list[bool]]]:
    """Lead cells of each row, a cell per policy, and True for cells without failures that another option flew."""
    for traffic in group.traffics:
        for altitude in group.altitudes:
            for part in group.parts:
                cells = [part.cell(metric, traffic, altitude, policy) for policy in group.policies]
                whole = [not part.failed_alone(traffic, altitude, policy) for policy in group.policies]
                levels = {"traffic": traffic, "altitude_m": altitude, **part.key}
                if any(cell is not None for cell in cells):
                    yield [TableCell(level_text(name, levels[name])) for name in _leading(group)], cells, whole


def _rows(group: Group, metric: str) -> list[Row | None]:
    return [cell for _, cells, _ in _lines(group, metric) for cell in cells]


def _leading(group: Group) -> tuple[str, ...]:
    return ("traffic", "altitude_m", *group.swept)


def _heads(group: Group) -> tuple[str, ...]:
    policies = (level_text("policy", policy) for policy in group.policies)
    return *(factor_text(name) for name in _leading(group)), *policies


def _caption(words: str, group: Group) -> str:
    return f"{words} ({group.title})" if group.title else words


def _cells(metric: Metric, cells: list[Row | None], whole: list[bool], usual: int) -> list[TableCell]:
    """The best of a row in bold, shared by ties as printed; none where all read the same or neither is better.

    Only those that are whole: the mean of one that failed where another flew leaves out what it failed on.
    """
    means = [shown(metric, cell["mean"] if cell is not None else None) for cell in cells]
    known = [mean for mean, fair in zip(means, whole, strict=True) if fair and mean != MISSING]
    rank = min if metric.more_is_better is False else max
    best = rank(known, key=_value) if metric.more_is_better is not None and len(set(known)) > 1 else None
    return [
        _cell(metric, cell, fair and mean == best, usual) for cell, mean, fair in zip(cells, means, whole, strict=True)
    ]


def _cell(metric: Metric, cell: Row | None, best: bool, usual: int) -> TableCell:
    if cell is None or cell["mean"] is None:
        return TableCell(MISSING)
    spread = f" ± {shown(metric, cell['sd'])}" if cell["sd"] is not None else ""
    mark = FEW_MARK if cell["n"] < FEW <= usual else ""
    number = f" ({cell['n']}{mark})" if cell["n"] != usual else ""
    return TableCell(shown(metric, cell["mean"]) + spread, best, number)


def _value(text: str) -> float:
    return float(text.replace("−", "-"))


def _tail(metric: Metric, cell: Row | None) -> str:
    if cell is None or cell["median"] is None:
        return MISSING
    return " / ".join(shown(metric, cell[name]) for name in ("median", "p95", "maximum"))


def _rests_on(metric: Metric, rows: Sequence[Row]) -> list[str]:
    """On how many defects the means of a share of them rest."""
    words = defects_under(rows) if metric.of else ""
    return [f"Each mean rests on {words}."] if words else []


def defects_under(rows: Iterable[Row]) -> str:
    """`54 defects`, `48 to 54 defects`: under each mean; empty where the study's table does not count them."""
    counts = sorted({row["defects"] for row in rows if row.get("defects")})
    ends = [f"{count:,}".replace(",", "\u2009") for count in dict.fromkeys((*counts[:1], *counts[-1:]))]
    return f"{' to '.join(ends)} defect{'s' * (counts[-1] != 1)}" if counts else ""


def _without(group: Group) -> list[str]:
    """Notes on missions without a swept setting, which stand at each of its values."""
    without_it = {name: group.without(name) for name in group.swept}
    return [
        f"The same missions of {policies} stand with every value of {factor_text(name)}, which they do not have."
        for name, policies in without_it.items()
        if policies
    ]


def _of_bold(body: Sequence[Sequence[TableCell]], *, partial: bool) -> list[str]:
    """The meaning of bold, if any cell is.

    Args:
        partial: an option failed in missions that another flew.
    """
    if not any(cell.strong for line in body for cell in line):
        return []
    left = " A mean that leaves out missions which failed and another option flew is never bold." if partial else ""
    return [f"Bold: the best mean of a row as printed, shared by ties; that alone makes no difference certain.{left}"]


def _notes(rows: list[Row], usual: int) -> list[str]:
    but = " unless a number in brackets states another" if any(row["n"] != usual for row in rows) else ""
    few = any(0 < row["n"] < FEW for row in rows)
    undefined, failed = (sum(row[name] or 0 for row in rows) for name in ("undefined", "failed"))
    notes = (
        (True, f"n = {usual} in each cell{but}."),
        (usual < FEW, "These are too few for the certainty of a mean."),
        (few and usual >= FEW, f"{FEW_MARK}: too few for the certainty of the mean."),
        (undefined, f"{counted(undefined, 'mission')} without a defined value (see the definitions) left out."),
        (failed, f"{counted(failed, 'mission')} failed and left out."),
        (any(row["mean"] is None for row in rows), f"{MISSING}: no defined value."),
    )
    return [note for applies, note in notes if applies]


_LATEX: Final = {
    "\\": r"\textbackslash{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "±": r"$\pm$",
    "×": r"$\times$",
    "−": r"$-$",
    "—": "---",
    "–": "--",
    "†": r"\dag{}",
    "\u00a0": "~",
    "\u2009": r"\,",
}


_AIRY: Final = 5  # Tables with more columns are set tighter, to fit the page of an article


def csv(summary: pl.DataFrame) -> str:
    """One row a cell and metric with all columns of the summary, in the units of the study's table."""
    return summary.write_csv()


def differences_csv(study: Study) -> str:
    """One row a comparison and metric, of every factor whose levels are compared."""
    frames = [
        found.differences.select(
            pl.lit(found.factor).alias("factor"), pl.lit(str(found.reference)).alias("reference"), pl.all()
        )
        for found in study.comparisons
    ]
    return pl.concat(frames).write_csv()


def markdown(study: Study) -> str:
    return f"# {_markdown(study.title)}\n\n" + "\n".join(markdown_table(table) for _, table in _labelled(study))


def latex(study: Study) -> str:
    """The headline tables of all groups, each a `table` environment."""
    head = f"% {_one_line(study.title)}\n% Needs \\usepackage[T1]{{fontenc}} and \\usepackage{{booktabs}}.\n\n"
    return head + "\n".join(latex_table(table, f"tab:{label}") for label, table in _labelled(study))


def markdown_table(table: Table) -> str:
    """Caption, pipes and notes. Lead cells are repeated, so that each row stands by itself."""
    rule = ["---" if at < table.lead else "---:" for at in range(len(table.heads))]
    lines = [
        [_markdown(head) for head in table.heads],
        rule,
        *([_strong_md(cell) for cell in row] for row in table.rows),
    ]
    body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    notes = f"\n{_markdown(' '.join(table.notes))}\n" if table.notes else ""
    return f"**{_markdown(table.caption)}**\n\n{body}\n{notes}"


def latex_table(table: Table, label: str) -> str:
    """A `table` environment; with vertical space before each block of the first column."""
    numbers = len(table.heads) - table.lead
    span = [
        rf"{' & ' * table.lead}\multicolumn{{{numbers}}}{{c}}{{{escape(table.span)}}} \\",
        rf"\cmidrule(l){{{table.lead + 1}-{len(table.heads)}}}",
    ]
    return "\n".join(
        [
            r"\begin{table}[htbp]",
            r"\centering",
            rf"\caption{{{escape(table.caption)}}}",
            rf"\label{{{label}}}",
            r"\smallskip",
            r"\small",
            *([r"\setlength{\tabcolsep}{3.5pt}"] if len(table.heads) > _AIRY else []),
            rf"\begin{{tabular}}{{@{{}}{'l' * table.lead}{'r' * numbers}@{{}}}}",
            r"\toprule",
            *(span if table.span and numbers > 1 else []),
            rf"{' & '.join(escape(head) for head in table.heads)} \\",
            r"\midrule",
            *_latex_rows(table),
            r"\bottomrule",
            r"\end{tabular}",
            *([rf"\par\smallskip\footnotesize {escape(' '.join(table.notes))}"] if table.notes else []),
            r"\end{table}",
            "",
        ]
    )


def escape(text: str) -> str:
    """Text for LaTeX: its special characters escaped, line ends as spaces."""
    return "".join(_LATEX.get(sign, sign) for sign in _one_line(text))


def _latex_rows(table: Table) -> Iterable[str]:
    for at, row in enumerate(table.rows):
        if at and table.starts(at, 0):
            yield r"\addlinespace"
        lead = [escape(cell.text) if table.height(at, column) else "" for column, cell in enumerate(row[: table.lead])]
        yield rf"{' & '.join([*lead, *(_strong_tex(cell) for cell in row[table.lead :])])} \\"


def _strong_tex(cell: TableCell) -> str:
    return (rf"\textbf{{{escape(cell.text)}}}" if cell.strong else escape(cell.text)) + escape(cell.aside)


def _strong_md(cell: TableCell) -> str:
    return (f"**{_markdown(cell.text)}**" if cell.strong else _markdown(cell.text)) + cell.aside


def _markdown(text: str) -> str:
    """Signs that would be markup are escaped, and the line stays one."""
    return re.sub(r"([\\`*_{}\[\]<>#|~])", r"\\\1", _one_line(text))


def _one_line(text: str) -> str:
    return re.sub(r"[\r\n\t]+", " ", text)


def _labelled(study: Study) -> Iterable[tuple[str, Table]]:
    """Each table with a label that no other has."""
    for at, group in enumerate(study.groups(), start=1):
        for metric, table in headline_tables(group):
            yield f"{metric.name.replace('_', '-')}-{at}" if group.key else metric.name.replace("_", "-"), table
