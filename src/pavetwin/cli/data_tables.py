"""Output of `pavetwin data`: the first lines of a report, and tables of classes and sources."""

from pathlib import Path
from typing import TYPE_CHECKING

from pavetwin.cli.console import err

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.labels.common_form import DatasetCounts
    from pavetwin.training.datasets.allocation import CopyPlan
    from pavetwin.training.datasets.report import Report
    from pavetwin.training.datasets.splitting import SplitShares

REFUSED_CODE = 1
"""Exit code where files of a source were refused; the others are in the dataset."""

SHOWN = 20
"""Lines of a report on the terminal; all are in its file."""

NOTES_SHOWN = 3
"""Notes on the terminal: a merge has one for every two pictures of one place."""


def print_report(report: "Report", folder: Path) -> None:
    """The report's first lines, refusals first, on the error stream; and where all of it is."""
    from pavetwin.training.datasets.report import FILE, UNLABELLED, Finding

    order = list(Finding)
    lines = sorted(report, key=lambda problem: order.index(problem.finding))
    found = [problem for problem in lines if problem.finding is not Finding.NOTE]
    notes = [problem for problem in lines if problem.finding is Finding.NOTE]
    for problem in found[:SHOWN] + notes[:NOTES_SHOWN]:
        err.line(f"{problem.finding.value}: {problem}")
    if lines:
        counts = ", ".join(f"{report.counts[each]} {each.value}" for each in order if report.counts[each])
        more = f" but {report.unlisted}, which are only counted" if report.unlisted else ""
        err.line(f"{counts}; all{more} in {folder / FILE}")
    if report.unlabelled:
        err.line(
            f"Pictures without a label: {folder / UNLABELLED}. Look at them; those that show nothing of any class are "
            "kept as background if this list is given (--background, or `background` of a recipe)."
        )


def splits_table(found: "SplitShares") -> "Table":
    """A row a class: the share of its instances in each split."""
    from rich.table import Table

    from pavetwin.labels import SPLITS

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("share of", no_wrap=True)
    for name in SPLITS:
        table.add_column(f"{name} %", justify="right")
    for name, shares in found.shares.items():
        table.add_row(name, *(f"{100 * share:.1f}" for share in shares))
    return table


def balance_table(plan: "CopyPlan") -> "Table":
    """A row a class that the dataset shows: its instances before and after."""
    from rich.table import Table

    from pavetwin.labels.common_form import class_names

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("instances of", no_wrap=True)
    for heading in ("before", "after", "of target %"):
        table.add_column(heading, justify="right")
    for name, before, after in zip(class_names(), plan.present.tolist(), plan.reached.tolist(), strict=True):
        if before:
            table.add_row(name, str(before), str(after), f"{100 * after / plan.target:.1f}")
    return table


def counts_table(title: str, counts: "DatasetCounts") -> "Table":
    """A row a source, and the sums."""
    from rich.table import Table

    from pavetwin.labels.common_form import class_names

    several = len(counts.sources) > 1
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, header_style="bold", show_footer=several)
    table.add_column("source", "all", no_wrap=True)
    for name in class_names():
        table.add_column(name.replace(" ", "\n"), str(counts.of_class(name)), justify="right", vertical="bottom")
    sums = (
        ("ignored", counts.ignored),
        ("images\nannotated", counts.annotated),
        ("images\nbackground", counts.background),
        ("images\ntotal", counts.annotated + counts.background),
    )
    for heading, counter in sums:
        table.add_column(heading, str(counter.total()), justify="right", vertical="bottom")
    table.add_column("scenes", str(sum(map(len, counts.groups.values()))), justify="right", vertical="bottom")
    for source in counts.sources:
        cells = [counts.instances[source, name] for name in class_names()]
        cells += [counter[source] for _, counter in sums]
        table.add_row(source, *map(str, cells), str(len(counts.groups[source])))
    return table
