"""`python -m benchmarks.study_pairs OTHER`: the paper's study by this checkout and by another one, cell by cell.

    git worktree add ../before COMMIT    # and build its kernel: make setup
    python -m benchmarks.study_pairs ../before

Each checkout builds the generated town with the damage that the paper describes and no parked vehicles, records traffic
of its own, and flies the 720 missions. Prints how far the means of the 36 cells of traffic, altitude and policy are
apart, in their units and in standard errors of the differences between replicates of the same number, of which there
are 20; and what either recommends. About three minutes.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple
from unittest.mock import patch

import polars as pl

from benchmarks.process import run
from pavetwin.cli.console import out, progress
from pavetwin.world.folder import CACHE_VARIABLE

ROOT: Final = Path(__file__).resolve().parent.parent
CELL: Final = ("traffic", "altitude_m", "policy")
METRICS: Final = ("coverage", "time_s", "surface_coverage")

TOWN: Final = ("world", "build", "--generate", "town", "--seed", "2", "-o", "town")
AS_BEFORE: Final = ("--damage", "paper", "--parking-rule", "none")
"""What a checkout that knows more defects and parked vehicles needs for the same town."""

RECOMMEND: Final = "import sys; from pavetwin.cli import main; sys.stdout = open('advice.txt', 'w'); main()"


class Difference(NamedTuple):
    """Of a metric, between the cells of two studies."""

    metric: str
    largest: float
    """Absolute, of all cells."""
    largest_se: float
    """The same in standard errors of the difference."""
    beyond: int
    """Cells whose difference is beyond 1.96 standard errors."""
    cells: int


def compared(before: pl.DataFrame, now: pl.DataFrame, metric: str) -> Difference:
    """How far the cells' means of a metric are apart, by the differences of replicates with the same number.

    Args:
        before: a row for each mission: `CELL`, `replicate` and the metric.
        now: the same of the other study, with the same cells.

    Raises:
        ValueError: the cells are not the same, or one has fewer than two replicates that both have.
    """
    value = pl.col(metric)
    first, second = (table.filter(value.is_not_null() & value.is_not_nan()) for table in (before, now))
    if not first.select(CELL).unique().sort(CELL).equals(second.select(CELL).unique().sort(CELL)):
        raise ValueError("the studies do not have the same cells")
    by = [*CELL, "replicate"]
    both = first.join(second.select(*by, metric), on=by, suffix="_now")
    apart = pl.col(f"{metric}_now") - value
    cells = both.group_by(CELL).agg(
        apart.mean().abs().alias("mean"), (apart.std() / apart.count().sqrt()).alias("se"), apart.count().alias("n")
    )
    if int(cells["n"].min() or 0) < 2 or len(cells) < first.select(CELL).n_unique():  # type: ignore[arg-type]
        raise ValueError("a cell has fewer than two replicates in both studies")
    in_se = pl.when(pl.col("mean") > 0).then(pl.col("mean") / pl.col("se")).otherwise(0.0)
    largest, largest_se, beyond = cells.select(
        pl.col("mean").max(), in_se.max().alias("most"), (in_se > 1.96).sum().alias("beyond")
    ).row(0)
    return Difference(metric, largest, largest_se, beyond, len(cells))


def study(root: Path, place: Path, more: Sequence[str]) -> tuple[pl.DataFrame, str]:
    """The missions of a checkout's study, and its advice.

    Args:
        place: an empty folder for all that it makes.
        more: options of the town that this checkout needs.
    """
    place.mkdir()
    settings = {"PYTHONPATH": str(root.absolute() / "src"), CACHE_VARIABLE: str(place.absolute() / "cache")}
    with patch.dict(os.environ, settings):
        run((*TOWN, *more), folder=place)
        run(("experiment", "init", "study.yaml", "--preset", "paper", "--world", "town"), folder=place)
        run(("experiment", "run", "study.yaml", "-o", "study"), folder=place)
        run(("experiment", "recommend", "study"), code=RECOMMEND, folder=place)
    return pl.read_parquet(place / "study" / "segments.parquet"), (place / "advice.txt").read_text(encoding="utf-8")


def main(arguments: Sequence[str]) -> int:
    """The exit code: 1 where more cells than one in twenty are beyond their intervals."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.study_pairs", description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, metavar="OTHER", help="another checkout, its kernel built")
    asked = parser.parse_args(arguments)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pavetwin-study-")))
        tell = stack.enter_context(progress("Flying the study twice"))
        before, said_before = study(asked.other, folder / "before", ())
        tell(0.5, "the other checkout has flown")
        now, said_now = study(ROOT, folder / "now", AS_BEFORE)
    found = [compared(before, now, metric) for metric in METRICS]
    for each in found:
        out.print(
            f"{each.metric}: {each.cells} cells, {each.largest:.3g} apart at most, {each.largest_se:.2g} standard "
            f"errors at most, {each.beyond} beyond 1.96",
            markup=False,
            soft_wrap=True,
        )
    for name, said in (("before", said_before), ("now", said_now)):
        out.print(f"Recommended {name}:\n{said.strip()}", markup=False, soft_wrap=True)
    return int(any(each.beyond > each.cells / 20 for each in found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
