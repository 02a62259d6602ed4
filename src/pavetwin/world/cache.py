"""What can be computed again, in the user's cache: recordings, NavMeshes, textures, tiles, placed defects, splits.

A world's folder may be read-only, and is left as it was built. The folder in the cache is named by the world's content
hash: a world that has changed never reads what was made from another. The cache has a bound: what was not used for
longest goes first.
"""

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World

SIZE_VARIABLE: Final = "PAVETWIN_CACHE_GB"
"""Environment variable: the most that the cache holds, in GB."""

MOST_GB: Final = 4.0
"""The same unless it is set: the tiles of some 1,500 places."""

LEFT_FREE: Final = 0.1
"""Share of the bound that is freed when it is reached, so that it is not reached again at once."""

IN_USE_S: Final = 86_400.0
"""What was made from a world and used since is not removed: a mission may be reading it."""


def cache_folder() -> Path:
    """Where the cache is: `PAVETWIN_CACHE`, or `pavetwin` in the user's cache folder (`XDG_CACHE_HOME`, `~/.cache`)."""
    if own := os.environ.get(CACHE_VARIABLE):
        return Path(own).absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pavetwin"


def texture_folder() -> Path:
    """Where textures are that are the same in every world."""
    return cache_folder() / "textures"


def cached(world: World, file: str) -> Iterator[Path]:
    """Where a file that is made from a world may be: in the cache, where it is written, then in the world's folder,
    where earlier versions wrote it.

    Args:
        file: its path within either, such as `traffic/high-1.parquet`.

    Raises:
        PaveTwinError: the world was never saved.
    """
    folder = world.network_file.parent
    path = cache_folder() / "worlds" / (world.content_hash[:16] or folder.name) / file
    mark_used(path)
    yield path
    yield folder / file


def mark_used(path: Path) -> None:
    """Note that a file of the cache is used now, if it is there: many file systems do not note when a file is read."""
    with suppress(OSError):
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))


def tile_folder() -> Path:
    """Where tiles of scenes are, and what they are made from."""
    return cache_folder() / "tiles"


def placed_folder() -> Path:
    """Where defects are that were placed on segments of worlds."""
    return cache_folder() / "defects"


def split_folder() -> Path:
    """Where it is kept which streets of worlds are in which split of datasets."""
    return cache_folder() / "splits"


def most_bytes() -> int:
    """How much the cache may hold.

    Raises:
        PaveTwinError: `PAVETWIN_CACHE_GB` is not a number above 0.
    """
    said = os.environ.get(SIZE_VARIABLE, "")
    try:
        most = 1e9 * float(said or MOST_GB)
        if 0 < most < float("inf"):
            return int(most)
    except ValueError:
        pass
    raise PaveTwinError(f"{SIZE_VARIABLE} is '{said}'; give the most that the cache may hold in GB, such as 4.")


def cache_size() -> tuple[int, int]:
    """How many worlds are in the cache, and the bytes of all its files."""
    folder = cache_folder() / "worlds"
    worlds = sum(path.is_dir() for path in folder.iterdir()) if folder.is_dir() else 0
    return worlds, sum(status.st_size for _, status in _files())


def make_room() -> None:
    """Remove the files that were not used for longest, if the cache holds more than it may.

    Raises:
        PaveTwinError: as `most_bytes`.
    """
    most, files = most_bytes(), list(_files())
    held = sum(status.st_size for _, status in files)
    if held <= most:
        return
    worlds, in_use = cache_folder() / "worlds", time.time() - IN_USE_S
    for path, status in sorted(files, key=lambda file: _last_use(file[1])):
        if held <= (1 - LEFT_FREE) * most:
            break
        if path.is_relative_to(worlds) and _last_use(status) > in_use:
            continue
        with suppress(OSError):  # another process may have removed it
            path.unlink()
            held -= status.st_size
            path.parent.rmdir()  # unless another file is in it


def _last_use(status: os.stat_result) -> float:
    return max(status.st_atime, status.st_mtime)


def _files() -> Iterator[tuple[Path, os.stat_result]]:
    """The files of the cache that are whole, and none that somebody else put there."""
    # Other processes make and remove folders meanwhile; `os.walk` passes over what is gone.
    for folder, _, names in chain.from_iterable(map(os.walk, _folders())):
        for path in (Path(folder, name) for name in names if not name.startswith(".")):
            with suppress(OSError):
                yield path, path.stat()


def _folders() -> tuple[Path, ...]:
    return cache_folder() / "worlds", texture_folder(), tile_folder(), placed_folder(), split_folder()


def clear_cache() -> None:
    """Remove all files from the cache that are ours; they are made again when they are needed.

    Raises:
        PaveTwinError: something cannot be removed.
    """
    for folder in _folders():
        try:
            if folder.is_dir():
                shutil.rmtree(folder)
        except OSError as error:
            raise PaveTwinError(f"Cannot clear the cache: {unwritable(folder, error)}") from error
