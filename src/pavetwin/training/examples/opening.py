"""A dataset from its path, whichever form it has."""

from collections.abc import Sequence
from pathlib import Path

from pavetwin.errors import PaveTwinError
from pavetwin.training.examples.coco import read_coco
from pavetwin.training.examples.example import SPLITS_USED, ExampleSet
from pavetwin.training.examples.pack import read_pack


def read_examples(paths: Sequence[Path], splits: tuple[str, ...] = SPLITS_USED) -> list[ExampleSet]:
    """The examples of folders with COCO files, and of packed files.

    Raises:
        PaveTwinError: one is not there, cannot be read, or has labels out of range.
    """
    found = []
    for path in paths:
        if not path.exists():
            raise PaveTwinError(f"There is no dataset '{path}'.")
        found.append(read_coco(path, splits) if path.is_dir() else read_pack(path, splits))
    return found
