"""What every command shares on the terminal: the console, the progress bar, and how an error is shown."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

PIPE_COLUMNS = 120
"""Width of what goes into a file or a pipe, which has none of its own."""

LINE_S = 10.0
"""Between two lines of progress where there is no terminal."""

out = Console(highlight=False, width=None if sys.stdout.isatty() or os.environ.get("COLUMNS") else PIPE_COLUMNS)
err = Console(stderr=True, highlight=False)


class Bar:
    """A progress bar: call it with the share done, 0 … 1, and now and then with what is being done."""

    def __init__(self, bar: Progress, what: str) -> None:
        self._bar, self._what = bar, what
        self._task = bar.add_task(what, total=1.0)

    def __call__(self, share: float, what: str | None = None) -> None:
        self._bar.update(self._task, completed=share, description=what or self._what)


class Lines:
    """A progress bar's place where the error stream is a file: a plain line every tenth of the way and every 10 s."""

    def __init__(self, what: str) -> None:
        self._what, self._stage, self._tenth, self._told_s = what, "", 0, time.monotonic()

    def __call__(self, share: float, what: str | None = None) -> None:
        text = what or self._what
        stage, tenth = text.rstrip("0123456789/ "), int(10 * share + 1e-9)
        if stage != self._stage:
            self._stage, self._tenth = stage, 0
        if tenth > self._tenth or time.monotonic() - self._told_s > LINE_S:
            self._tenth, self._told_s = tenth, time.monotonic()
            sys.stderr.write(f"{text} ({share:.0%})\n")
            sys.stderr.flush()


@contextmanager
def progress(what: str, *, lines: bool = False) -> Iterator[Bar | Lines]:
    """A progress bar on the error stream, so that results can be piped. When that is no terminal, plain silence, or
    `lines` for what takes long."""
    if lines and not err.is_terminal:
        yield Lines(what)
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=err, transient=True, disable=not err.is_terminal) as bar:
        yield Bar(bar, what)


@contextmanager
def counting(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A progress bar over `total` things; call it with the name of each as it is done."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        yield lambda name: bar.update(task, advance=1, description=f"{what} [dim]{name}[/]")


def fail(message: str) -> None:
    """One plain line on the error stream."""
    text = " ".join(message.split())
    prefix = "[bold red]Error:[/] " if err.is_terminal and not os.environ.get("NO_COLOR") else "Error: "
    if err.is_terminal:
        err.print(prefix, end="")
    else:
        sys.stderr.write(prefix)
    sys.stderr.write(text + "\n")
