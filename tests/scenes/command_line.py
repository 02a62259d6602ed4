"""`pavetwin …` as a user types it: in this process, or in one of its own where that matters."""

import os
import re
import signal
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from unittest.mock import patch

from pavetwin.cli import console, main

COLUMNS = 200


def command(*arguments: object) -> list[str]:
    """The command line of a process of its own."""
    return [sys.executable, "-c", "from pavetwin.cli import main; main()", *map(str, arguments)]


def pavetwin_process(*arguments: object, **how: object) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own; `how` goes to `subprocess.run`."""
    how = {"env": {**os.environ, "COLUMNS": str(COLUMNS)}, **how}
    return subprocess.run(command(*arguments), capture_output=True, text=True, check=False, **how)


def pavetwin(*arguments: object, cwd: Path | str = ".", columns: int = COLUMNS) -> subprocess.CompletedProcess[str]:
    """Run a command in this process, which saves the second that a new one takes to import what the command needs."""
    words, printed, failed = ["pavetwin", *map(str, arguments)], StringIO(), StringIO()
    for late in (console.out, console.err):
        vars(late).pop("rich", None)  # as wide as the command before asked for
    on_terminate = signal.getsignal(signal.SIGTERM)
    try:
        with (
            patch.object(sys, "argv", words),
            patch.dict(os.environ, {"COLUMNS": str(columns)}),
            redirect_stdout(printed),
            redirect_stderr(failed),
            chdir(cwd),
        ):
            main()
    except SystemExit as ended:
        code = int(ended.code or 0)
    finally:
        signal.signal(signal.SIGTERM, on_terminate)
        for late in (console.out, console.err):
            vars(late).pop("rich", None)
    return subprocess.CompletedProcess(words, code, printed.getvalue(), failed.getvalue())


def plain_refusal(done: subprocess.CompletedProcess[str]) -> str:
    """The one line of an error; asserts that it is one, with exit code 2."""
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = without_progress(done.stderr)
    assert line.startswith("Error: ")
    return line


def without_progress(text: str) -> list[str]:
    """The lines of an error stream without those of progress, which a slow machine prints."""
    return [line for line in text.splitlines() if not re.search(r"( …|\(\d+ ?%(, .* left)?\))$", line)]


SHORT = ("--density", "low", "--segments", "2", "--seed", "1")
