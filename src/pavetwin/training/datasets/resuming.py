"""Stages of a dataset that resume where they stopped: checks of the output folder, work ahead, whole files."""

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any, Final, TypeVar

from pavetwin.errors import PaveTwinError
from pavetwin.files import PICTURE_SUFFIXES, file_sha256
from pavetwin.labels.common_form import DESCRIPTION, read_description
from pavetwin.training.datasets.pictures import files_in

THREADS: Final = 2
AHEAD: Final = 8
"""Pieces of work in progress before the first of them is used."""

_LABEL_SUFFIXES: Final = frozenset({".xml", ".txt", ".json", ".yaml", ".yml", ".csv"})

Work = TypeVar("Work")
Made = TypeVar("Made")

OnStage = Callable[[float, str], None]
"""Called with the finished share of a stage, 0 … 1, and the stage's name."""


def made_ahead(
    found: Iterator[Work], make: Callable[[Work], Made], *, exists: Callable[[Work], bool]
) -> Iterator[tuple[Work, Future[Made] | None]]:
    """Each piece of work with its future result, in the given order; None where the result exists already.

    Threads work a few pieces ahead of the one in use, so memory does not grow with a dataset.
    """
    with ThreadPoolExecutor(THREADS) as threads:
        waiting: deque[tuple[Work, Future[Made] | None]] = deque()
        for work in found:
            waiting.append((work, None if exists(work) else threads.submit(make, work)))
            if len(waiting) > AHEAD:
                yield waiting.popleft()
        while waiting:
            yield waiting.popleft()


def fingerprint(folder: Path) -> str:
    """SHA-256 of the names and contents of a folder's pictures, masks and label files.

    It distinguishes corrected labels and exchanged pictures from those imported before.
    """
    digest = sha256()
    for path in files_in(folder, PICTURE_SUFFIXES | _LABEL_SUFFIXES):
        file = folder / path
        try:
            with file.open("rb") as stream:
                content = file_digest(stream, "sha256").hexdigest()
        except OSError:
            content = "unreadable"
        digest.update(os.fsencode(f"{path}\0{content}\0"))
    return digest.hexdigest()


def check_same(output: Path, expected: dict[str, Any], name: str = DESCRIPTION) -> None:
    """Check that a folder is empty or holds an earlier run of the same, according to its description `name`.

    Raises:
        PaveTwinError: it holds something else.
    """
    if output.exists() and not output.is_dir():
        raise PaveTwinError(f"'{output}' is a file; choose another folder.")
    if not (output / name).is_file():
        if output.is_dir() and any(output.iterdir()):
            raise PaveTwinError(f"'{output}' holds something else; choose another folder.")
        return
    found = read_description(output, name)
    differ = [key for key, value in expected.items() if found.get(key) != value]
    if differ:
        what = "command" if differ[0] == "made_by" else differ[0]
        raise PaveTwinError(f"'{output}' holds a dataset made with another {what}; choose another folder.")


def described(folder: Path) -> dict[str, str]:
    """Name and hash of a finished dataset, for the description of one made from it.

    Raises:
        PaveTwinError: it is not finished.
    """
    if not read_description(folder).get("complete"):
        raise PaveTwinError(f"'{folder}' is not finished; run the command that makes it again.")
    return {"name": folder.absolute().name, "sha256": file_sha256(folder / DESCRIPTION)}


def move_in(staging: Path, target: Path, content: bytes) -> None:
    """Write a file completely or not at all, by way of a staging folder on the same disk."""
    (staging / target.name).write_bytes(content)
    (staging / target.name).replace(target)
