"""The results of one group of cells: its tables and figures, each with a caption that can stand alone."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

from pavetwin.experiments.metrics import Metric, metric_named
from pavetwin.experiments.report import headline
from pavetwin.experiments.report.canvas import vector
from pavetwin.experiments.report.parts import Block, Cell, Fold, Section, Table, Text
from pavetwin.experiments.report.plots import forest, intervals, spread, tradeoff
from pavetwin.experiments.report.study import METRIC, Group
from pavetwin.experiments.report.words import MISSING, factor_text, heading, level_text, listed, p_text, shown

SEEN: Final = ("coverage", "swath_coverage", "recovery")
SPENT: Final = ("time_s", "energy", "wait_s")
COMPARED: Final = ("coverage", "time_s", "energy")
"""Headline metrics of figures that have room for three."""

_MOST_COLUMNS: Final = 4
_MOST_ROWS: Final = 44
"""Of a forest plot: what fits a page."""


def group_sections(group: Group, prefix: str, *, brief: bool = False) -> Iterator[Section]:
    """The sections of a group in the order of the page; what has nothing to show is left out.

    Args:
        prefix: what anchors of this group begin with.
        brief: only the tables of means.
    """
    builders = (
        ("means", "Mean values", _means),
        ("intervals", "Intervals by density and altitude", _intervals),
        ("differences", "Paired differences to baseline", _differences),
        ("tradeoffs", "What coverage costs", _tradeoffs),
        ("spread", "Spread and tails", _spread),
    )
    for name, title, build in builders[:1] if brief else builders:
        section = Section(f"{prefix}{name}", title, list(build(group)))
        if not section.empty:
            yield section


def _means(group: Group) -> Iterator[Block]:
    yield from (table for _, table in headline.headline_tables(group))


def _intervals(group: Group) -> Iterator[Block]:
    for what, names in (("what is seen", SEEN), ("what it costs", SPENT)):
        metrics = _known(group, names)
        for traffics in _parts(group.traffics, _MOST_COLUMNS) if metrics else ():
            words = listed([metric.label.lower() for metric in metrics])
            yield vector(
                intervals.by_altitude(group, metrics, traffics),
                f"{words.capitalize()} by traffic density and altitude{_of(group)} ({what}): means with 95 % "
                "bootstrap intervals over replicates. Marks at one altitude stand side by side only to be told apart.",
                f"Interval plots of {words}, a column for each traffic density ({_names('traffic', traffics)}), "
                f"altitude from left to right, policies {_names('policy', group.policies)}.",
            )


def _differences(group: Group) -> Iterator[Block]:
    policies = forest.compared(group)
    metrics = [metric for metric in _known(group, COMPARED) if metric.name in set(group.differences[METRIC])]
    if not policies or not metrics:
        return
    yield Text(
        "Policies of one replicate flew the same segment with the same traffic, defects and luck, so each is compared "
        "with baseline mission by mission. An interval that includes 0 leaves open which of the two is better."
    )
    for traffics in _fitting(group):
        yield vector(
            forest.forest(group, metrics, forest.places(group, traffics)),
            f"Mean paired difference to baseline{_of(group)}: "
            f"{listed([metric.label.lower() for metric in metrics])}, with 95 % bootstrap intervals. p: sign-flip "
            "permutation test after Holm's correction over all comparisons of the metric; filled marks have "
            f"p < {forest.LEVEL:g}.",
            f"Forest plot of the differences of {_names('policy', policies)} to baseline, a row for each traffic "
            "density, altitude and policy.",
        )
    yield Fold("The differences as numbers", _difference_table(group, metrics))


def _difference_table(group: Group, metrics: Sequence[Metric]) -> Table:
    found = {
        (row[METRIC], row["traffic"], row["altitude_m"], row["policy"]): row
        for row in group.differences.iter_rows(named=True)
    }
    rows = []
    for place in forest.places(group, group.traffics):
        lead = [Cell(level_text(axis, level)) for axis, level in zip(_AXES, place, strict=True)]
        cells = [cell for m in metrics for cell in _difference_cells(m, found.get((m.name, *place)))]
        rows.append((*lead, *cells))
    heads = [head for metric in metrics for head in (heading(metric), "p")]
    caption = f"Mean paired difference to baseline{_of(group)} with its 95 % interval, and corrected p"
    notes = (f"Bold: p < {forest.LEVEL:g} after correction.",)
    return Table(caption, (*(factor_text(axis) for axis in _AXES), *heads), tuple(rows), lead=3, notes=notes)


_AXES: Final = ("traffic", "altitude_m", "policy")


def _difference_cells(metric: Metric, row: Any) -> tuple[Cell, Cell]:
    if row is None or row["mean"] is None:
        return Cell(MISSING), Cell(MISSING)
    ends = f" [{shown(metric, row['low'])}, {shown(metric, row['high'])}]" if row["low"] is not None else ""
    differs = row["p_corrected"] is not None and row["p_corrected"] < forest.LEVEL
    return Cell(shown(metric, row["mean"]) + ends, differs), Cell(p_text(row["p_corrected"]), differs)


def _tradeoffs(group: Group) -> Iterator[Block]:
    gain = metric_named("coverage")
    known = _known(group, COMPARED)
    if gain not in known or len(group.altitudes) * len(group.policies) < 2:
        return
    yield Text(
        "Of the options in one traffic density, those on the front are worth considering: no other has at least their "
        "mean coverage at no more of their mean cost. The front is one of means: where intervals overlap, another "
        "sample may order two neighbours the other way round."
    )
    for cost in known[1:]:
        for traffics in _parts(group.traffics, _MOST_COLUMNS):
            label = cost.label.lower()
            yield vector(
                tradeoff.tradeoff(group, gain, cost, traffics),
                f"Mean coverage over mean {label}{_of(group)} with 95 % intervals. Colour and mark are the policy, "
                "size is the altitude. Strong marks with a dark rim lie on the front, pale ones do not.",
                f"Scatter of mean coverage over mean {label}, a panel for each traffic density "
                f"({_names('traffic', traffics)}), with the Pareto front as steps.",
            )
        yield _front_table(group, gain, cost)


def _front_table(group: Group, gain: Metric, cost: Metric) -> Table:
    rows = []
    for traffic in group.traffics:
        best = [option for option in tradeoff.options(group, traffic, gain, cost) if option.on_front]
        for option in sorted(best, key=lambda option: float(option.cost["mean"])):
            lead = (("traffic", traffic), ("altitude_m", option.altitude_m), ("policy", option.policy))
            numbers = (_mean_interval(gain, option.gain), _mean_interval(cost, option.cost))
            rows.append((*(Cell(level_text(*words)) for words in lead), *(Cell(number) for number in numbers)))
    heads = (*(factor_text(axis) for axis in _AXES), heading(gain), heading(cost))
    caption = f"On the front of mean coverage and mean {cost.label.lower()}{_of(group)}, the cheapest first"
    return Table(caption, heads, tuple(rows), lead=3, notes=("In brackets: 95 % intervals.",))


def _mean_interval(metric: Metric, row: Any) -> str:
    ends = f" [{shown(metric, row['low'])}, {shown(metric, row['high'])}]" if row["low"] is not None else ""
    return shown(metric, row["mean"]) + ends


def _spread(group: Group) -> Iterator[Block]:
    for metric in _known(group, ("time_s", "energy", "coverage")):
        for traffics in _parts(group.traffics, _MOST_COLUMNS):
            yield vector(
                spread.spread(group, metric, traffics),
                f"{metric.label} of every mission{_of(group)}: a dot each, over them the median (thick), the middle "
                "half (box) and the 5th to 95th percentile (whiskers).",
                f"Box plots with dots of {metric.label.lower()} by traffic density, altitude and policy.",
            )
        if metric.name in headline.TAILS:
            yield headline.tail_table(group, metric)


def _known(group: Group, names: Sequence[str]) -> list[Metric]:
    """Those that have a defined mean in the group."""
    rows = group.summary.drop_nulls("mean")
    defined = set(rows[METRIC].to_list())
    return [metric_named(name) for name in names if name in defined]


def _fitting(group: Group) -> Iterator[list[Any]]:
    """Densities together as far as their comparisons fit a page."""
    part: list[Any] = []
    for traffic in group.traffics:
        if part and len(forest.places(group, [*part, traffic])) > _MOST_ROWS:
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
