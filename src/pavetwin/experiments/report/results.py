"""The results of one group of cells: its tables and figures, each with a caption that can stand alone."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any, Final

import polars as pl

from pavetwin.experiments.metrics import COMPARED, INDEX_ERROR, Metric, metric_named
from pavetwin.experiments.report import figures, tables
from pavetwin.experiments.report.study import AXES, METRIC, Group, replicates
from pavetwin.experiments.report.tables import FEW_MARK
from pavetwin.experiments.statistics.paired import Comparison, is_significant
from pavetwin.experiments.statistics.simultaneous import ALPHA
from pavetwin.experiments.statistics.summary import FEW
from pavetwin.experiments.words import factor_text, factors_text, heading, level_text, shown, subject
from pavetwin.reports.blocks import Block, Section, Table, TableCell, text_cells
from pavetwin.reports.canvas import vector
from pavetwin.reports.words import MISSING, counted, listed, p_text

SEEN: Final = ("coverage", "swath_coverage", "recovery")
SPENT: Final = ("time_s", "energy", "wait_s")
WRONG: Final = ("precision", "false_alarms_per_100_m2")
ACCURACY: Final = (INDEX_ERROR,)

_ENOUGH_OF_WAITING: Final = 20
"""With fewer replicates, simultaneous intervals of metrics that depend on waiting miss their level by far."""
_MOST_COLUMNS: Final = 4
_MOST_ROWS: Final = 44  # Largest number of rows of a forest plot that fits a page


def group_builders(group: Group, *, brief: bool = False) -> list[Callable[[str], Section]]:
    """Builders of the sections of a group in the order of the page; each takes the prefix of the anchors.

    Args:
        brief: only the tables of means.
    """
    references = listed([level_text("policy", found.reference) for found in group.study.compared("policy")])
    builders: tuple[tuple[str, str, Callable[[Group], Iterator[Block]]], ...] = (
        ("means", "Mean values", _means),
        *(
            (f"over-{at}", f"Over {factor_text(name)}", partial(_over, factor=name))
            for at, name in enumerate(group.swept, start=1)
        ),
        ("intervals", "Intervals by density and altitude", _intervals),
        (
            "differences",
            f"Paired differences to {references}",
            partial(_differences, factor="policy"),
        ),
        ("altitudes", "Altitudes against each other", partial(_differences, factor="altitude_m")),
        ("tradeoffs", "Cost of coverage", _tradeoffs),
        ("spread", "Spread and tails", _spread),
    )

    def builder(name: str, title: str, build: Callable[[Group], Iterator[Block]]) -> Callable[[str], Section]:
        return lambda prefix: Section(f"{prefix}{name}", title, list(build(group)))

    return [builder(*parts) for parts in (builders[:1] if brief else builders)]


def _means(group: Group) -> Iterator[Block]:
    yield from (table for _, table in tables.headline_tables(group))


def _over(group: Group, factor: str) -> Iterator[Block]:
    """Every metric over the values of a swept setting, and their differences."""
    usual = group.at(
        {name: level for name, level in group.study.usual.items() if name in group.swept and name != factor}
    )
    for metric in _known(group, COMPARED):
        for traffics in _parts(group.traffics, _MOST_COLUMNS):
            yield vector(
                figures.across(usual, factor, metric, traffics),
                f"{metric.label} over {factor_text(factor)}{_of(usual)}: means with 95 % bootstrap intervals over "
                "replicates, a row for each altitude and a column for each traffic density. "
                f"{_side_by_side(factor)} {_without(group, factor)}".strip(),
                f"Line plots of {metric.label.lower()} over {factor_text(factor)}, by altitude, policies "
                f"{_names('policy', group.policies)}.",
            )
    yield from _differences(group, factor)


def _intervals(group: Group) -> Iterator[Block]:
    group = group.usual
    parts = {
        "what is seen": SEEN,
        "what it costs": SPENT,
        "what is reported wrongly": WRONG,
        "accuracy of the index": ACCURACY,
    }
    for what, names in parts.items():
        metrics = _known(group, names)
        for traffics in _parts(group.traffics, _MOST_COLUMNS) if metrics else ():
            words = listed([metric.label.lower() for metric in metrics])
            rests = tables.defects_under(
                row for row in group.summary.iter_rows(named=True) if row[METRIC] == metrics[0].name
            )
            yield vector(
                figures.by_altitude(group, metrics, traffics),
                f"{words.capitalize()} by traffic density and altitude{_of(group)} ({what}): means with 95 % "
                f"bootstrap intervals over replicates. {_side_by_side('altitude_m')}"
                + (f" Each {metrics[0].label.lower()} rests on {rests}." if rests else ""),
                f"Interval plots of {words}, a column for each traffic density ({_names('traffic', traffics)}), "
                f"altitude from left to right, policies {_names('policy', group.policies)}.",
            )


def _side_by_side(factor: str) -> str:
    where = "altitude" if factor == "altitude_m" else f"value of {factor_text(factor)}"
    return f"Marks at one {where} stand side by side only so that they do not overlap."


def _without(group: Group, factor: str) -> str:
    named = group.without(factor)
    return f"At “{figures.WITHOUT}” stand policies that have no {factor_text(factor)}: {named}." if named else ""


def _differences(group: Group, factor: str) -> Iterator[Block]:
    """Each level of a factor against its references: the figures, and their numbers in tables."""
    compared = [found for found in group.study.compared(factor) if group.differences(found).height]
    for comparison in compared:
        rows = group.differences(comparison)
        known = set(rows[METRIC])
        metrics = [metric for metric in _known(group, COMPARED) if metric.name in known]
        if metrics:
            yield from _against(group, comparison, rows, metrics, first=comparison is compared[0])


def _against(
    group: Group, comparison: Comparison, rows: pl.DataFrame, metrics: Sequence[Metric], *, first: bool
) -> Iterator[Block]:
    """The differences to one reference; before the first of a section, how they are made."""
    factor, other = comparison.factor, subject(comparison.factor, comparison.reference)
    if first:
        why = f" ({comparison.reason})" if comparison.reason else ""
        whom = f"{other}{why}" if comparison.number == comparison.differences["p"].count() else "the others"
        yield (
            "Missions of one replicate share segment, traffic, defects and seed, so each is compared with "
            f"{whom} mission by mission. An interval that includes 0 leaves open which of the two is better."
        )
        if narrow := _narrow(group, metrics):
            yield narrow
    family = f"{counted(comparison.number, 'comparison')} {_family(group, factor)} in {_COMPARED}"
    together = (
        f"Intervals and p are corrected for all {family} together: an interval excludes 0 exactly where p < {ALPHA:g}"
    )
    for traffics in _fitting(group, rows):
        yield vector(
            figures.forest(group, rows, metrics, figures.places(group, rows, traffics)),
            f"Mean paired difference to {other}{_of(group)}: {listed([metric.label.lower() for metric in metrics])}, "
            f"with simultaneous 95 % intervals. {together}; such marks are filled.{_unbounded(rows)}",
            f"Forest plot of the differences to {other}, a row for each traffic density, altitude and policy.",
        )
    yield _difference_table(group, rows, other, metrics, together)


def _family(group: Group, factor: str) -> str:
    """`with baseline`, `between altitudes`."""
    references = [found.reference for found in group.study.compared(factor)]
    return f"between {factors_text(factor)}" if len(references) > 1 else f"with {subject(factor, references[0])}"


def _narrow(group: Group, metrics: Sequence[Metric]) -> str:
    """A warning if few replicates hold little evidence about waiting times."""
    result, count = group.result, replicates(group.study)
    waits = set(result.filter(pl.col("wait_s") > 0)["policy"].to_list())
    costs = [metric.label.lower() for metric in metrics if metric.name in SPENT]
    if not waits or not costs or count >= _ENOUGH_OF_WAITING:
        return ""
    named = listed([level_text("policy", policy) for policy in group.policies if policy in waits])
    return (
        f"Differences in {listed(costs)} that depend on waiting ({named}) are uncertain: waiting is skewed, and "
        f"{counted(count, 'replicate')} show too little of its tail. Their intervals are too short: in simulations a "
        f"whole family held in 25 of 100 cases with 10 replicates and in 77 with {_ENOUGH_OF_WAITING}, instead of 95."
    )


_COMPARED: Final = listed([metric_named(name).label.lower() for name in COMPARED])


def _unbounded(rows: pl.DataFrame) -> str:
    bare = rows.filter(pl.col("p").is_not_null() & pl.col("low").is_null()).height
    return " Marks without an interval have too few pairs to exclude anything." if bare else ""


def _difference_table(group: Group, rows: pl.DataFrame, other: str, metrics: Sequence[Metric], together: str) -> Table:
    axes = figures.axes_of(group)
    found = {(row[METRIC], *(row[name] for name in axes)): row for row in rows.iter_rows(named=True)}
    body = []
    for place in figures.places(group, rows, group.traffics):
        lead = text_cells(*map(level_text, axes, place))
        cells = [cell for m in metrics for cell in _difference_cells(m, found.get((m.name, *place)))]
        body.append((*lead, *cells))
    heads = [head for metric in metrics for head in (heading(metric), "p")]
    caption = f"Mean paired difference to {other}{_of(group)} with its simultaneous 95 % interval, and corrected p"
    notes = (f"{together}; such are bold.",)
    heads = [*(factor_text(axis) for axis in axes), *heads]
    opened_by = "The differences as numbers"
    return Table(caption, tuple(heads), tuple(body), lead=len(axes), notes=notes, opened_by=opened_by)


def _difference_cells(metric: Metric, row: Any) -> tuple[TableCell, ...]:
    if row is None or row["mean"] is None:
        return text_cells(MISSING, MISSING)
    ends = f" [{shown(metric, row['low'])}, {shown(metric, row['high'])}]" if row["low"] is not None else ""
    words = (shown(metric, row["mean"]) + ends, p_text(row["p_corrected"]))
    return tuple(TableCell(text, is_significant(row)) for text in words)


def _tradeoffs(group: Group) -> Iterator[Block]:
    group = group.usual
    gain = metric_named("coverage")
    known = _known(group, COMPARED)
    if gain not in known or len(group.altitudes) * len(group.policies) < 2:
        return
    yield (
        "The options on the front of a traffic density are worth considering: no other has at least their mean "
        "coverage at no more than their mean cost. The front is one of means: where intervals overlap, another "
        "sample may swap two neighbours." + _kept_off(group)
    )
    for cost in known[1:]:
        for traffics in _parts(group.traffics, _MOST_COLUMNS):
            label = cost.label.lower()
            yield vector(
                figures.tradeoff(group, gain, cost, traffics),
                f"Mean coverage over mean {label}{_of(group)} with 95 % intervals. Colour and mark are the policy, "
                "size is the altitude. Strong marks with a dark rim lie on the front, pale ones do not.",
                f"Scatter of mean coverage over mean {label}, a panel for each traffic density "
                f"({_names('traffic', traffics)}), with the Pareto front as steps.",
            )
        yield _front_table(group, gain, cost)


def _kept_off(group: Group) -> str:
    """The options that cannot be on the front."""
    failed = {
        option: sum(group.failed_alone(traffic, *option) for traffic in group.traffics)
        for option in product(group.altitudes, group.policies)
    }
    named = [
        f"{level_text('policy', policy)} at {level_text('altitude_m', altitude_m)} ({count} failed)"
        for (altitude_m, policy), count in failed.items()
        if count
    ]
    if not named:
        return ""
    return (
        " An option that failed in missions that others flew is not on the front of that density, since its means "
        f"leave them out: {listed(named)}."
    )


def _front_table(group: Group, gain: Metric, cost: Metric) -> Table:
    rows = []
    for traffic in group.traffics:
        best = [option for option in figures.options(group, traffic, gain, cost) if option.on_front]
        for option in sorted(best, key=lambda option: float(option.cost["mean"])):
            lead = map(level_text, AXES, (traffic, option.altitude_m, option.policy))
            rows.append(text_cells(*lead, _mean_interval(gain, option.gain), _mean_interval(cost, option.cost)))
    heads = (*(factor_text(axis) for axis in AXES), heading(gain), heading(cost))
    caption = f"On the front of mean coverage and mean {cost.label.lower()}{_of(group)}, the cheapest first"
    few = any(row["n"] < FEW for row in group.summary.filter(pl.col("n") > 0).iter_rows(named=True))
    notes = ("In brackets: 95 % intervals.", *([f"{FEW_MARK}: too few values."] if few else []))
    return Table(caption, heads, tuple(rows), lead=3, notes=notes)


def _mean_interval(metric: Metric, row: Any) -> str:
    ends = f" [{shown(metric, row['low'])}, {shown(metric, row['high'])}]" if row["low"] is not None else ""
    return shown(metric, row["mean"]) + ends + (FEW_MARK if row["n"] < FEW else "")


def _spread(group: Group) -> Iterator[Block]:
    group = group.usual
    for metric in _known(group, ("time_s", "energy", "coverage")):
        for traffics in _parts(group.traffics, _MOST_COLUMNS):
            yield vector(
                figures.spread(group, metric, traffics),
                f"{metric.label} of every mission{_of(group)}: a dot each, over them the median (thick), the middle "
                "half (box) and the 5th to 95th percentile (whiskers).",
                f"Box plots with dots of {metric.label.lower()} by traffic density, altitude and policy.",
            )
        if metric.name in tables.TAILS:
            yield tables.tail_table(group, metric)


def _known(group: Group, names: Sequence[str]) -> list[Metric]:
    """Metrics with a defined mean in the group."""
    rows = group.summary.drop_nulls("mean")
    defined = set(rows[METRIC].to_list())
    return [metric_named(name) for name in names if name in defined]


def _fitting(group: Group, rows: pl.DataFrame) -> Iterator[list[Any]]:
    """Densities together as far as their comparisons fit a page."""
    part: list[Any] = []
    for traffic in group.traffics:
        if part and len(figures.places(group, rows, [*part, traffic])) > _MOST_ROWS:
            yield part
            part = []
        part.append(traffic)
    yield part


def _parts(levels: Sequence[Any], most: int) -> Iterator[Sequence[Any]]:
    """Cut into parts of about equal length, none longer than `most`."""
    count = -(-len(levels) // most)
    size = -(-len(levels) // max(count, 1))
    return (levels[at : at + size] for at in range(0, len(levels), size))


def _names(factor: str, levels: Sequence[Any]) -> str:
    return listed([level_text(factor, level) for level in levels])


def _of(group: Group) -> str:
    return f" ({group.title})" if group.title else ""
