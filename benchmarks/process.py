"""A command of the program in a process of its own, and what it took."""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pavetwin.errors import PaveTwinError

_COMMAND = "from pavetwin.cli import main; main()"

_MEASURE = """
import json, os, subprocess, sys
process = subprocess.Popen([sys.executable, "-c", *sys.argv[2:]], stdout=2)
_, status, used = os.wait4(process.pid, 0)
code = os.waitstatus_to_exitcode(status)
print(json.dumps([code, used.ru_utime + used.ru_stime, used.ru_maxrss]), file=open(sys.argv[1], "w"))
"""
"""Starts the command from a process that holds little: of a command that this one starts, the system would report at
least the memory that this one holds."""


@dataclass(frozen=True)
class Used:
    """By a process and those it waited for."""

    processor_s: float
    """User and system."""
    wall_s: float
    peak_mib: float
    """The most memory that one of them held."""


def run(words: Sequence[str], code: str = _COMMAND, expected: int | None = 0, folder: Path | None = None) -> Used:
    """A command of the program, to its end.

    Args:
        code: of Python, where it is another program.
        expected: the exit code; None for any.
        folder: where it is run; the current one unless given.

    Raises:
        PaveTwinError: it ended with another code.
    """
    begun = time.perf_counter()
    with tempfile.TemporaryFile() as printed, tempfile.NamedTemporaryFile("r") as told:
        words = [sys.executable, "-S", "-c", _MEASURE, told.name, code, *words]
        # Images of containers often set this, and would have each process compile all that it imports.
        settings = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        subprocess.run(words, stdout=printed, stderr=printed, cwd=folder, env=settings, check=True)
        ended, processor_s, peak = json.load(told)
        wall_s = time.perf_counter() - begun
        if expected is not None and ended != expected:
            printed.seek(0)
            said = printed.read().decode(errors="replace").strip()
            raise PaveTwinError(f"`pavetwin {' '.join(words[6:])}` failed: {said[-200:]}")
    return Used(processor_s, wall_s, peak / (2**20 if sys.platform == "darwin" else 2**10))


def peak_mib(process: int | None = None) -> float:
    """The most memory that a running process has held so far, this one unless given; another one's on Linux alone.

    Linux tells it of the process by itself: its `ru_maxrss` begins with that of its parent.
    """
    status = Path("/proc") / str(process or "self") / "status"
    if process is not None or status.is_file():
        told = next(line for line in status.read_text(encoding="utf-8").splitlines() if line.startswith("VmHWM:"))
        return int(told.split()[1]) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
