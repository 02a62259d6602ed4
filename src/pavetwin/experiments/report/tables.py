"""Tables as files: tidy CSV, Markdown as GitHub shows it, LaTeX with booktabs."""

import re
from collections.abc import Iterable
from typing import Final

import polars as pl

from pavetwin.experiments.report.headline import headline_tables
from pavetwin.experiments.report.study import Study
from pavetwin.reports.blocks import Table, TableCell

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


_AIRY: Final = 5
"""With more columns they stand closer, so that the page of an article holds them."""


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
    """As LaTeX sets it: its own signs escaped, line ends as spaces."""
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
