"""The tables of a paper: density and altitude down the side, policies across, mean ± SD, the best of a row in bold."""

from collections.abc import Iterator
from typing import Any, Final

from pavetwin.experiments.metrics import Metric, metric_named
from pavetwin.experiments.report.parts import Cell, Table
from pavetwin.experiments.report.study import Group, Row
from pavetwin.experiments.report.words import MISSING, counted, factor_text, heading, level_text, shown

HEADLINE: Final = ("coverage", "swath_coverage", "recovery", "time_s", "energy")
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
    body = tuple(
        (*_lead(traffic, altitude), *_cells(metric, cells, usual))
        for traffic, altitude, cells in _lines(group, metric.name)
    )
    return Table(
        caption=_caption(f"{heading(metric)}: mean ± standard deviation", group),
        heads=_heads(group),
        rows=body,
        notes=_notes(rows, usual, bold=any(cell.strong for line in body for cell in line)),
        span=factor_text("policy"),
    )


def tail_table(group: Group, metric: Metric) -> Table:
    """Median, 95th percentile and maximum of every cell."""
    body = tuple(
        (*_lead(traffic, altitude), *(Cell(_tail(metric, cell)) for cell in cells))
        for traffic, altitude, cells in _lines(group, metric.name)
    )
    caption = f"{heading(metric)}: median / 95th percentile / maximum"
    return Table(_caption(caption, group), _heads(group), body, span=factor_text("policy"))


def _lines(group: Group, metric: str) -> Iterator[tuple[Any, Any, list[Row | None]]]:
    for traffic in group.traffics:
        for altitude in group.altitudes:
            cells = [group.cell(metric, traffic, altitude, policy) for policy in group.policies]
            if any(cell is not None for cell in cells):
                yield traffic, altitude, cells


def _rows(group: Group, metric: str) -> list[Row | None]:
    return [cell for _, _, cells in _lines(group, metric) for cell in cells]


def _lead(traffic: Any, altitude: Any) -> tuple[Cell, Cell]:
    return Cell(level_text("traffic", traffic)), Cell(level_text("altitude_m", altitude))


def _heads(group: Group) -> tuple[str, ...]:
    policies = (level_text("policy", policy) for policy in group.policies)
    return factor_text("traffic"), factor_text("altitude_m"), *policies


def _caption(words: str, group: Group) -> str:
    return f"{words} ({group.title})" if group.title else words


def _cells(metric: Metric, cells: list[Row | None], usual: int) -> list[Cell]:
    """The best of a row in bold, shared by ties as printed; none where all read the same or neither is better."""
    means = [shown(metric, cell["mean"] if cell is not None else None) for cell in cells]
    known = [mean for mean in means if mean != MISSING]
    rank = min if metric.more_is_better is False else max
    best = rank(known, key=_value) if metric.more_is_better is not None and len(set(known)) > 1 else None
    return [_cell(metric, cell, mean == best, usual) for cell, mean in zip(cells, means, strict=True)]


def _cell(metric: Metric, cell: Row | None, best: bool, usual: int) -> Cell:
    if cell is None or cell["mean"] is None:
        return Cell(MISSING)
    spread = f" ± {shown(metric, cell['sd'])}" if cell["sd"] is not None else ""
    return Cell(shown(metric, cell["mean"]) + spread, best, f" ({cell['n']})" if cell["n"] != usual else "")


def _value(text: str) -> float:
    return float(text.replace("−", "-"))


def _tail(metric: Metric, cell: Row | None) -> str:
    if cell is None or cell["median"] is None:
        return MISSING
    return " / ".join(shown(metric, cell[name]) for name in ("median", "p95", "maximum"))


def _notes(rows: list[Row], usual: int, *, bold: bool) -> list[str]:
    differing = any(row["n"] != usual for row in rows)
    notes = [f"n = {usual} in each cell" + (" but where a number in brackets says otherwise." if differing else ".")]
    undefined, failed = (sum(row[name] or 0 for row in rows) for name in ("undefined", "failed"))
    if undefined:
        notes.append(f"{counted(undefined, 'mission')} without a defined value (see the definitions) left out.")
    if failed:
        notes.append(f"{counted(failed, 'mission')} failed and left out.")
    if any(row["mean"] is None for row in rows):
        notes.append(f"{MISSING}: no defined value.")
    if bold:
        notes.append("Bold: the best mean of a row as printed, shared by ties; that alone makes no difference certain.")
    return notes
