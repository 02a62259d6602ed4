"""Folders of the session that several tasks may make at the same time."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.files import staging_folder, working_in

WAITING_S: Final = 0.1
"""Between two looks whether another task is still at work in a folder."""


@contextmanager
def made_once(target: Path) -> Iterator[Path]:
    """A temporary folder of this task's own, which becomes `target` at the end of the block.

    The name of `target` says what is in it: where another task has made it meanwhile, that one stays.

    Raises:
        PaveTwinError: it cannot be written. Nothing is left behind.
    """
    with staging_folder(target) as made:
        yield made
        try:
            made.replace(target)
        except OSError:
            if not target.is_dir():
                raise


@contextmanager
def alone_in(folder: Path, session: Path, tell: Callable[[float, str], None]) -> Iterator[None]:
    """While the block runs, no other task of the session that asks the same works in a folder of missions.

    Args:
        session: its folder, which gets the lock: what is cancelled leaves nothing beside the missions.
        tell: told that another task is waited for.
    """
    name = session / f"mission-{sha256(str(folder.absolute()).encode()).hexdigest()[:20]}"
    with ExitStack() as held:
        while True:
            try:
                held.enter_context(working_in(name))
                break
            except PaveTwinError as error:
                if not isinstance(error.__cause__, BlockingIOError):
                    raise
            tell(0.0, "Waiting for another page with the same mission")
            time.sleep(WAITING_S)
        yield
