"""The processes that record, as the system lists them."""

import time
from collections.abc import Callable
from pathlib import Path


def children(process: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def templates(owner: int) -> list[int]:
    """What an owner's simulations are forked off; they stay."""
    return [child for child in children(owner) if b"traffic.template" in Path(f"/proc/{child}/cmdline").read_bytes()]


def simulations(owner: int) -> list[int]:
    """The processes that simulate for an owner."""
    return [child for template in templates(owner) for child in children(template)]


def is_gone(process: int) -> bool:
    """One that has ended stays listed until its parent has asked after it."""
    try:
        return not Path(f"/proc/{process}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return True


def is_over(what: Callable[[], bool]) -> bool:
    patience = time.monotonic() + 20
    while not what() and time.monotonic() < patience:
        time.sleep(0.05)
    return what()
