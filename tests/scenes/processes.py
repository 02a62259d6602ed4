"""The processes that record, as the system lists them."""

import os
import time
from collections.abc import Callable
from pathlib import Path


def parent(process: int) -> int | None:
    """None for one that is gone."""
    try:
        state = Path(f"/proc/{process}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return int(state.rpartition(")")[2].split()[1])


def children(process: int) -> list[int]:
    """Children of all its threads: the system's list of a thread's own children omits those of another thread until
    that one has ended altogether, which is after it was joined."""
    listed = [int(folder.name) for folder in Path("/proc").iterdir() if folder.name.isdecimal()]
    return sorted(child for child in listed if parent(child) == process)


def command_line(process: int) -> bytes:
    """Nothing for one that has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def simulations(owner: int) -> list[int]:
    """The processes that simulate for an owner."""
    return [child for child in children(owner) if b"traffic.sumo_run" in command_line(child)]


def is_gone(process: int) -> bool:
    """One that has ended stays listed until its parent has asked after it."""
    return not command_line(process)


def is_over(what: Callable[[], bool]) -> bool:
    patience = time.monotonic() + 60
    while not what() and time.monotonic() < patience:
        time.sleep(0.05)
    return what()


def resident_bytes() -> int:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
