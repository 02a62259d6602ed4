"""A command of the program in a process of its own, and what it took."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass

from pavetwin.errors import PaveTwinError

_COMMAND = "from pavetwin.cli import main; main()"


@dataclass(frozen=True)
class Used:
    """By a process and those it waited for."""

    processor_s: float
    """User and system."""
    wall_s: float
    peak_mib: float
    """The most memory that one of them held."""


def run(words: Sequence[str], code: str = _COMMAND, expected: int | None = 0) -> Used:
    """A command of the program, to its end.

    Args:
        code: of Python, where it is another program.
        expected: the exit code; None for any.

    Raises:
        PaveTwinError: it ended with another code.
    """
    begun = time.perf_counter()
    with tempfile.TemporaryFile() as printed:
        process = subprocess.Popen([sys.executable, "-c", code, *words], stdout=printed, stderr=printed)
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall_s = time.perf_counter() - begun
        if expected is not None and process.returncode != expected:
            printed.seek(0)
            said = printed.read().decode(errors="replace").strip()
            raise PaveTwinError(f"`pavetwin {' '.join(words)}` failed: {said[-200:]}")
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return Used(used.ru_utime + used.ru_stime, wall_s, used.ru_maxrss / unit)
