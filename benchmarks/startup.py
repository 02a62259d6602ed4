"""What a command costs before it does anything: processor time of a new process, user and system."""

import os
import statistics
import subprocess
import sys
from collections.abc import Iterator

from benchmarks.measure import Kind, Line
from pavetwin.errors import PaveTwinError

_COMMAND = "from pavetwin.cli import main; main()"


def lines(runs: int) -> Iterator[Line]:
    yield _line("pavetwin --version", _COMMAND, ["--version"], runs, target_s=0.2)
    yield _line("pavetwin fly, a misspelt world", _COMMAND, ["fly", "no-such-world"], runs, target_s=0.6)
    yield _line("pavetwin fly --help", _COMMAND, ["fly", "--help"], runs)
    yield _line("import pavetwin", "import pavetwin", [], runs)


def _line(what: str, code: str, words: list[str], runs: int, target_s: float | None = None) -> Line:
    times = [_python_s(code, words) for _ in range(runs + 1)][1:]  # the first run reads the files from the disk
    return Line(what, statistics.median(times), Kind.SECONDS, target_s, note="processor time, Python's own included")


def processor_s(words: list[str]) -> float:
    """Processor time of a command of the program, its child processes included.

    Raises:
        PaveTwinError: it failed.
    """
    return _python_s(_COMMAND, words, expected=0)


def _python_s(code: str, words: list[str], expected: int | None = None) -> float:
    before = os.times()
    ran = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)
    after = os.times()
    if expected is not None and ran.returncode != expected:
        raise PaveTwinError(f"`pavetwin {' '.join(words)}` failed: {ran.stderr.strip()[-200:]}")
    return after.children_user + after.children_system - before.children_user - before.children_system
