"""Textures and tables that depend on the code alone, or on a seed, kept in the cache: they take seconds to make.

A file that is damaged is made again; where none can be written, each process makes its own.
"""

import hashlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np

from pavetwin.arrays import AnyArray
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.seeds import __file__ as seeds_file
from pavetwin.world.cache import cache_folder

_FILES: Final = 3  # Files kept of one name, the last made, for other variants and earlier code


def kept(name: str, make: Callable[[], Mapping[str, AnyArray]], variant: int | str = 0) -> Mapping[str, AnyArray]:
    """Arrays by their names, from a file of the cache, which is made where there is none.

    Args:
        name: of the file; a hash of the code of scenes follows.
        variant: what else they depend on: a seed, or a hash of something.
    """
    path = cache_folder("textures") / f"{name}-{code_hash()}-{variant}.npz"
    with suppress(OSError, ValueError, KeyError, EOFError, BadZipFile), np.load(path) as file:
        return {column: file[column] for column in file.files}
    made: Mapping[str, Any] = make()
    with suppress(PaveTwinError, OSError):
        with writing(path) as temporary:
            np.savez(temporary, **made)
        for old in sorted(path.parent.glob(f"{name}-*.npz"), key=lambda each: -each.stat().st_mtime_ns)[_FILES:]:
            old.unlink()
    return made


@cache
def code_hash() -> str:
    """Hash of the code of scenes and of NumPy's version."""
    digest = hashlib.sha256(np.__version__.encode())
    for file in (*sorted(Path(__file__).parent.rglob("*.py")), Path(seeds_file)):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
