"""`python -m benchmarks.command_pairs OTHER`: whole commands of this checkout beside those of another one.

    git worktree add ../before COMMIT    # and build its kernel: make setup
    python -m benchmarks.command_pairs ../before

Each checkout builds worlds of its own with the same command, and has a cache of its own, so that either may be of a
format that the other cannot read. At every command both take turns; which one begins changes from command to command.
Prints the table of docs/reference/performance.md: what a user waits for, the processor time that it takes of all
cores, and the most memory that one process of it holds. The other checkout must know the commands below.
"""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, NamedTuple
from unittest.mock import patch

from benchmarks.process import Used, run
from pavetwin.cli.console import out, progress
from pavetwin.world.folder import CACHE_VARIABLE

ROOT: Final = Path(__file__).resolve().parent.parent
HIGH: Final = ("--density", "high", "--seed", "1")
CAPTURE: Final = ("capture", "make", "town", "-o")
ALTITUDES: Final = ("--altitude", "6", "--altitude", "10", "--altitude", "15")


class Step(NamedTuple):
    """One command, run in a folder of the checkout whose turn it is."""

    what: str
    """Empty where it prepares the next one and is not in the table."""
    words: tuple[str, ...]
    fails: bool = False
    """It ends with an error, as it should."""
    without_tiles: bool = False
    """The tiles that are in the cache are removed before."""


STEPS: Final = (
    Step("`fly` with a misspelt world", ("fly", "no-such-world"), fails=True),
    Step("building the demo's town", ("world", "build", "--generate", "town", "--seed", "1", "-o", "town")),
    Step("`fly`, 3 segments, high traffic, nothing recorded", ("fly", "town", "--segments", "3", *HIGH, "-o", "few")),
    Step("the same, recorded", ("fly", "town", "--segments", "3", *HIGH, "-o", "few", "--force")),
    Step("", (*CAPTURE, "first", "--images", "1", *ALTITUDES, *HIGH)),
    Step("from the command to the first frame", (*CAPTURE, "one", "--images", "1", *HIGH), without_tiles=True),
    Step("the same, tiles in the cache", (*CAPTURE, "two", "--images", "1", *HIGH)),
    Step("60 labelled images, recorded", (*CAPTURE, "many", "--images", "60", *ALTITUDES, *HIGH), without_tiles=True),
    Step("the same, tiles in the cache", (*CAPTURE, "more", "--images", "60", *ALTITUDES, *HIGH)),
    Step("", ("world", "build", "--generate", "town", "--seed", "2", "-o", "studied")),
    Step("", ("experiment", "init", "study.yaml", "--preset", "paper", "--world", "studied")),
    Step("the paper's study, nothing recorded", ("experiment", "run", "study.yaml", "-o", "study")),
    Step("the same, recorded", ("experiment", "run", "study.yaml", "-o", "again")),
    Step("", ("world", "build", "--generate", "random", "--seed", "0", "-o", "random")),
    Step("a survey of 40 segments, nothing recorded", ("fly", "random", "--segments", "40", *HIGH, "-o", "survey")),
    Step("the same, recorded", ("fly", "random", "--segments", "40", *HIGH, "-o", "survey", "--force")),
)


def measured(steps: Sequence[Step], roots: Sequence[Path], folder: Path) -> Iterator[tuple[Step, list[Used]]]:
    """Each step by each checkout, in turn; the results in the order of `roots`."""
    places = [folder / str(number) for number in range(len(roots))]
    for place in places:
        place.mkdir()
    for number, step in enumerate(steps):
        turns = [*range(len(roots))]
        took = {each: _run(step, roots[each], places[each]) for each in (turns if number % 2 == 0 else turns[::-1])}
        yield step, [took[each] for each in turns]


def _run(step: Step, root: Path, place: Path) -> Used:
    if step.without_tiles:
        shutil.rmtree(place / "cache" / "tiles", ignore_errors=True)
    settings = {"PYTHONPATH": str(root.absolute() / "src"), CACHE_VARIABLE: str(place.absolute() / "cache")}
    with patch.dict(os.environ, settings):
        return run(step.words, expected=2 if step.fails else 0, folder=place)


def row(step: Step, before: Used, now: Used) -> str:
    """A row of the table."""
    cells = [
        f"{before.wall_s:.3g}; **{now.wall_s:.3g} s**",
        f"{before.processor_s:.3g}; {now.processor_s:.3g} s",
        f"{now.processor_s / before.processor_s:.2f}",
        f"{before.peak_mib:,.0f}; {now.peak_mib:,.0f} MiB",
    ]
    return "| " + " | ".join([step.what, *cells]) + " |"


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.command_pairs", description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, metavar="OTHER", help="another checkout, its kernel built")
    parser.add_argument("--steps", type=int, default=len(STEPS), help="only so many of the commands")
    asked = parser.parse_args(arguments)
    rows = [
        "| what | wall clock, before; now | processor time | ratio of it | memory |",
        "|---|---|---|---|---|",
    ]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pavetwin-pairs-")))
        tell = stack.enter_context(progress("Comparing"))
        steps = STEPS[: asked.steps]
        for number, (step, (before, now)) in enumerate(measured(steps, (asked.other, ROOT), folder), start=1):
            tell(number / len(steps), step.what or " ".join(step.words[:2]))
            if step.what:
                rows.append(row(step, before, now))
                out.print(rows[-1], markup=False, soft_wrap=True)
    print("\n".join(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
