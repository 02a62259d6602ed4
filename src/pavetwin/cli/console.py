"""Terminal output of all commands: results, progress, errors, and silence of libraries."""

import logging
import os
import re
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from functools import cached_property
from io import UnsupportedOperation
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TextIO

from pavetwin.errors import CacheWarning

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from pavetwin.world.model import World


PIPE_COLUMNS = 120
"""Width of what goes into a file or a pipe, which has none of its own."""

LINE_S = 10.0
"""Between two lines of progress where there is no terminal."""

STAGE_S = 2.0
"""Shorter stages are not announced there."""


class LateConsole:
    """A rich console, imported when something is first printed: most errors are found before that."""

    def __init__(self, *, stderr: bool) -> None:
        self._stderr = stderr

    @cached_property
    def rich(self) -> "Console":
        from rich.console import Console

        if self._stderr:
            return Console(stderr=True, highlight=False)
        fixed = not sys.stdout.isatty() and not os.environ.get("COLUMNS")
        return Console(highlight=False, width=PIPE_COLUMNS if fixed else None)

    def print(self, *things: Any, **options: Any) -> None:
        """See `rich.console.Console.print`."""
        self.rich.print(*things, **options)

    def line(self, text: str) -> None:
        """Plain text, not broken to the width of the terminal: paths and commands can be copied."""
        self.print(text, markup=False, soft_wrap=True)


out = LateConsole(stderr=False)
err = LateConsole(stderr=True)


class Bar:
    """A progress bar: call it with the share done, 0 … 1, and optionally with the present stage. A share that falls
    begins another stage. The time left is estimated from the pace so far where it is not given."""

    def __init__(self, bar: "Progress", what: str) -> None:
        self._bar, self._what, self._share = bar, what, 0.0
        self._task = bar.add_task(what, total=1.0)

    def __call__(self, share: float, what: str | None = None, remaining_s: float | None = None) -> None:
        if share < self._share:
            # The time of the previous stage does not predict this one.
            self._bar.reset(self._task)
        self._share = share
        self._bar.update(self._task, completed=share, description=what or self._what, remaining_s=remaining_s)


class Lines:
    """Replaces the progress bar where the error stream is a file: a plain line 2 s into a stage and every 10 s, also
    between calls, and with `tenths` at every tenth of it."""

    def __init__(self, what: str, *, tenths: bool = True) -> None:
        self._tenths = tenths
        self._what, self._text, self._share, self._stage, self._tenth = what, what, 0.0, "", 0
        self._remaining_s: float | None = None
        self._due_s = time.monotonic() + STAGE_S
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._clock = threading.Thread(target=self._remind, daemon=True)

    def __enter__(self) -> Self:
        self._clock.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._ended.set()
        self._clock.join()

    def __call__(self, share: float, what: str | None = None, remaining_s: float | None = None) -> None:
        with self._lock:
            self._text, self._share, self._remaining_s = what or self._what, share, remaining_s
            stage, tenth = re.sub(r"[0-9/]+", "", self._text), int(10 * share + 1e-9)
            if stage != self._stage:
                self._stage, self._tenth, self._due_s = stage, 0, time.monotonic() + STAGE_S
            if self._tenths and tenth > self._tenth:
                self._tenth = tenth
                self._print_line()

    def _remind(self) -> None:
        while not self._ended.wait(STAGE_S / 8):
            with self._lock:
                if time.monotonic() > self._due_s:
                    self._print_line()

    def _print_line(self) -> None:
        self._due_s = time.monotonic() + LINE_S
        left = "" if self._remaining_s is None else f", {timedelta(seconds=round(self._remaining_s))} left"
        sys.stderr.write(f"{self._text} ({self._share:.0%}{left})\n" if self._share else f"{self._text} …\n")
        sys.stderr.flush()


@contextmanager
def progress(what: str, *, lines: bool = False) -> Iterator[Bar | Lines]:
    """A progress bar on the error stream, so that results can be piped. If the stream is not a terminal, plain lines at
    intervals replace it, and with `lines` also at every tenth."""
    if not err.rich.is_terminal:
        with Lines(what, tenths=lines) as plain:
            yield plain
        return
    from rich.progress import BarColumn, Progress, SpinnerColumn, Task, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Remaining(TimeRemainingColumn):
        def render(self, task: Task) -> Text:
            left_s = task.fields.get("remaining_s")
            return super().render(task) if left_s is None else Text(str(timedelta(seconds=round(left_s))), "cyan")

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(*columns, Remaining(), console=err.rich, transient=True) as bar:
        yield Bar(bar, what)


def table(*headings: str, **options: Any) -> "Table":
    """A plain table; the first column is aligned to the left, the others to the right.

    Args:
        options: attributes of the table, see `rich.table.Table`.
    """
    from rich.table import Table

    made = Table(**{"box": None, "pad_edge": False, "header_style": "bold", **options})
    for at, heading in enumerate(headings):
        made.add_column(heading, justify="right" if at else "left", no_wrap=True)
    return made


def note_fonts(*worlds: "World") -> None:
    """Print the missing font package where images could not show the names of streets."""
    from pavetwin.draw.fonts import remark

    for words in dict.fromkeys(filter(None, map(remark, worlds))):
        out.line(f"Note: {words}")


def fail(message: str) -> None:
    """One plain line on the error stream."""
    text = " ".join(message.split())
    if sys.stderr.isatty() and not os.environ.get("NO_COLOR"):
        err.print("[bold red]Error:[/] ", end="")
    else:
        sys.stderr.write("Error: ")
    sys.stderr.write(text + "\n")


STDERR = 2


@contextmanager
def quiet() -> Iterator[None]:
    """Drop Python's warnings, logs without a handler, and all that native libraries and child processes print on the
    error stream. The program's own errors, progress and warnings still reach it, as `sys.stderr`; each warning once."""
    root, handler, own = logging.getLogger(), logging.NullHandler(), sys.stderr
    sys.stderr.flush()
    terminal = os.dup(STDERR)
    if _is_native(own):
        sys.stderr = os.fdopen(os.dup(STDERR), "w", 1, encoding=own.encoding, errors=own.errors)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    root.addHandler(handler)
    os.dup2(nowhere, STDERR)
    os.close(nowhere)
    try:
        with warnings.catch_warnings():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
                warnings.simplefilter("once", CacheWarning)
                warnings.showwarning = _show_warning
            yield
    finally:
        os.dup2(terminal, STDERR)
        os.close(terminal)
        root.removeHandler(handler)
        if sys.stderr is not own and _is_native(own):
            sys.stderr.close()
            sys.stderr = own


def _show_warning(
    message: Warning | str,
    category: type[Warning],  # noqa: ARG001 - the signature of `warnings.showwarning`
    filename: str,  # noqa: ARG001
    lineno: int,  # noqa: ARG001
    file: TextIO | None = None,  # noqa: ARG001
    line: str | None = None,  # noqa: ARG001
) -> None:
    print(message, file=sys.stderr)


def _is_native(stream: object) -> bool:
    """Whether a stream is the error stream of the process, not a replacement by a caller."""
    try:
        return stream.fileno() == STDERR  # type: ignore[attr-defined, no-any-return]
    except (AttributeError, UnsupportedOperation, ValueError):
        return False
