"""What a command costs before it does anything: processor time of a new process, user and system."""

import statistics
from collections.abc import Iterator

from benchmarks.measure import Kind, Line
from benchmarks.process import run


def lines(runs: int) -> Iterator[Line]:
    yield _line("pavetwin --version", ["--version"], runs, target_s=0.2)
    yield _line("pavetwin fly, a misspelt world", ["fly", "no-such-world"], runs, target_s=0.6)
    yield _line("pavetwin fly --help", ["fly", "--help"], runs)
    yield _line("import pavetwin", [], runs, code="import pavetwin")


def _line(what: str, words: list[str], runs: int, target_s: float | None = None, code: str | None = None) -> Line:
    more = {} if code is None else {"code": code}
    times = [run(words, expected=None, **more).processor_s for _ in range(runs + 1)]
    took_s = statistics.median(times[1:])  # the first run reads the files from the disk
    return Line(what, took_s, Kind.SECONDS, target_s, note="processor time, Python's own included")
