"""Sections about the whole study: what else was varied, which factor explains how much, streets, and failures."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Final

import polars as pl

from pavetwin.experiments.metrics import COMPARED, FAILED, FLOWN, REASON, STATUS, metric_named
from pavetwin.experiments.report import figures, maps
from pavetwin.experiments.report.study import AXES, METRIC, Group, Study
from pavetwin.experiments.statistics.sentences import EFFECT_ALPHA
from pavetwin.experiments.words import factor_text, heading, level_text, shown
from pavetwin.reports.blocks import Block, Section, Table, text_cells
from pavetwin.reports.canvas import vector
from pavetwin.reports.words import counted, listed, number

_MOST_RESTS: Final = 3
"""Combinations of the rest that one factor is drawn for."""
_MOST_MAPS: Final = 4
_WORST: Final = 10
"""Segments in the table of the least covered."""
_FEW: Final = 10
"""Of fewer defects not even half of the coverage is known: 3 of 6 found may be 12 to 88 %."""
_MOST_REASONS: Final = 20
_MOST_PLACES: Final = 4


def across_section(study: Study) -> Section:
    """Every factor that stands apart from left to right: the first levels of the rest, and as many more as there is
    room for."""
    blocks = [block for factor in study.apart for block in _across(study, factor)]
    return Section("across", f"Across {listed([factor_text(name).lower() for name in study.apart])}", blocks)


def _across(study: Study, factor: str) -> Iterator[Block]:
    names = [name for name in study.apart if name != factor]
    for rest in study.combinations(names)[:_MOST_RESTS]:
        group = Group(study, {**rest, **study.usual})
        words = ", ".join(f"{factor_text(n).lower()} {level_text(n, v)}" for n, v in group.key.items())
        for metric in (metric_named(name) for name in COMPARED):
            if metric not in study.metrics:
                continue
            yield vector(
                figures.across(group, factor, metric, group.traffics),
                f"{metric.label} over {factor_text(factor).lower()}{f' ({words})' if words else ''}: means with 95 % "
                "bootstrap intervals, a row for each altitude and a column for each traffic density.",
                f"Interval plots of {metric.label.lower()} over {factor_text(factor).lower()}, by altitude.",
            )


def effects_section(study: Study) -> Section:
    known = set(study.effects[METRIC].to_list()) if study.effects.height else set()
    metrics = [metric for metric in study.metrics if metric.name in known and metric.name in (*COMPARED, "recovery")]
    blocks: list[Block] = []
    if metrics:
        words = listed([metric.label.lower() for metric in metrics])
        blocks = [
            (
                "Replicates differ in street, traffic and defects; what they explain is what no altitude and no policy "
                "changes. An interaction (×) says that a factor matters differently at the levels of the other; those "
                "of three and more factors are in the residual. Here p is not corrected for being many: of what is "
                f"dark the findings name only what holds at {100 * EFFECT_ALPHA:g} % after Holm's correction for all."
            ),
            vector(
                figures.effect_bars(study.effects, metrics),
                f"Share of the variation of {words} that each term explains (analysis of variance with replicates as "
                f"blocks{_used(study.effects)}): η² of the whole as bars and numbers, "
                "partial ω² as diamonds and in brackets.",
                f"Bar charts of η² and ω² by term for {words}.",
            ),
        ]
    return Section("effects", "Which factor explains how much", blocks)


def _used(effects: pl.DataFrame) -> str:
    """How many replicates an analysis had, where the frame says so."""
    if "replicates" not in effects.columns:
        return ""
    least, most = (int(value) for value in effects.select(low=pl.min("replicates"), high=pl.max("replicates")).row(0))
    return f"; {least if least == most else f'{least} to {most}'} replicates have a value in every cell"


def streets_section(study: Study) -> Section:
    """A map of each world, and its least covered segments."""
    blocks: list[Block] = []
    for name in list(study.worlds)[:_MOST_MAPS]:
        means = maps.street_means(study.by_segment, name)
        picture = maps.street_map(study.worlds[name], means) if means.height else None
        if picture is not None:
            blocks += [picture, _worst(name, means), *_without_defects(study.by_segment, name)]
    return Section("streets", "Street by street", blocks)


def _without_defects(table: pl.DataFrame, world: str) -> list[str]:
    """How many segments were flown and have no coverage, if any."""
    flown = table.filter(pl.col("world") == world, pl.col(STATUS) == FLOWN)
    empty = flown.group_by("segment").agg(pl.col("coverage").count()).filter(pl.col("coverage") == 0).height
    if not empty:
        return []
    return [f"{counted(empty, 'more segment')} flown had no defects to find in any replicate, and no coverage."]


def _worst(world: str, means: pl.DataFrame) -> Table:
    coverage, time = metric_named("coverage"), metric_named("time_s")
    rows = tuple(
        text_cells(
            *(row["street"], row["segment"], number(row["length_m"], 0), f"{row['missions']} ({row['replicates']})"),
            f"{row['defects']}",
            *(shown(coverage, row["coverage"]), shown(time, row["time_s"])),
        )
        for row in means.head(_WORST).iter_rows(named=True)
    )
    words = f"The {_WORST} least covered segments" if means.height > _WORST else "Segments, the least covered first,"
    heads = ("Street", "Segment", "Length (m)", "Missions (replicates)", "Defects", f"Mean {heading(coverage).lower()}")
    notes: tuple[str, ...] = (
        "Missions of one replicate share their traffic and defects: what counts as evidence is the replicates.",
    )
    if any(row["defects"] < _FEW for row in means.head(_WORST).iter_rows(named=True)):
        notes += (f"A coverage of fewer than {_FEW} defects says little of its segment.",)
    return Table(f"{words} of {world}", (*heads, f"Mean {heading(time).lower()}"), rows, notes=notes, merged=False)


def failures_section(study: Study) -> Section:
    failed = study.table.filter(pl.col(STATUS) == FAILED)
    reasons = Counter(failed[REASON].fill_null("no reason given").to_list()) if failed.height else Counter[str]()
    blocks: list[Block] = []
    if reasons:
        rows = tuple(
            text_cells(reason, _where(failed, reason), f"{count}")
            for reason, count in reasons.most_common(_MOST_REASONS)
        )
        rest = len(reasons) - len(rows)
        notes = (f"{counted(rest, 'more reason')} in the study's table.",) if rest else ()
        blocks = [
            (
                f"{failed.height} of {counted(study.table.height, 'mission')} failed. They count "
                "in no mean; a cell that lost many is to be read with care."
            ),
            Table("Why missions failed, and where", ("Reason", "Cells", "Missions"), rows, notes=notes, merged=False),
        ]
    return Section("failures", "Missions that failed", blocks)


def _where(failed: pl.DataFrame, reason: str) -> str:
    """`high, 15 m, hover (3); …`."""
    rows = failed.filter(pl.col(REASON).fill_null("no reason given") == reason).iter_rows(named=True)
    cells = Counter(_cell(row) for row in rows).most_common()
    words = "; ".join(f"{cell} ({count})" for cell, count in cells[:_MOST_PLACES])
    return words + (f"; and {counted(len(cells) - _MOST_PLACES, 'more cell')}" if len(cells) > _MOST_PLACES else "")


def _cell(row: Mapping[str, Any]) -> str:
    return ", ".join(level_text(axis, row[axis]) for axis in AXES)
