"""What a command costs before it does anything: processor time of a new process, user and system."""

import os
import statistics
import subprocess
import sys
from collections.abc import Iterator

from benchmarks.measure import Kind, Line

COMMAND = "from pavetwin.cli import main; main()"


def lines(runs: int) -> Iterator[Line]:
    yield _line("pavetwin --version", [COMMAND, "--version"], runs, target_s=0.2)
    yield _line("pavetwin fly, a misspelt world", [COMMAND, "fly", "no-such-world"], runs, target_s=0.5)
    yield _line("import pavetwin", ["import pavetwin"], runs)


def _line(what: str, words: list[str], runs: int, target_s: float | None = None) -> Line:
    times = [_processor_s(words) for _ in range(runs + 1)][1:]  # the first run reads the files from the disk
    return Line(what, statistics.median(times), Kind.SECONDS, target_s, note="processor time, Python's own included")


def _processor_s(words: list[str]) -> float:
    before = os.times()
    subprocess.run([sys.executable, "-c", *words], capture_output=True, check=False)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system
