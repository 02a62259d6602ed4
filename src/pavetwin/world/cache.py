"""What can be computed again, in the user's cache: recordings and NavMeshes of worlds, and textures of the ground.

A world's folder may be read-only, and is left as it was built. The folder in the cache is named by the world's content
hash: a world that has changed never reads what was made from another.
"""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from pavetwin.errors import PaveTwinError
from pavetwin.files import unwritable
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World


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
    yield cache_folder() / "worlds" / (world.content_hash[:16] or folder.name) / file
    yield folder / file


def cache_size() -> tuple[int, int]:
    """How many worlds are in the cache, and bytes of all files, those of textures included."""
    folder = cache_folder() / "worlds"
    worlds = [path for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []
    files = (file for part in (*worlds, texture_folder()) for file in part.rglob("*") if file.is_file())
    return len(worlds), sum(file.stat().st_size for file in files)


def clear_cache() -> None:
    """Remove all worlds' files and all textures from the cache; they are made again when they are needed.

    Raises:
        PaveTwinError: something cannot be removed.
    """
    for folder in (cache_folder() / "worlds", texture_folder()):
        try:
            if folder.is_dir():
                shutil.rmtree(folder)
        except OSError as error:
            raise PaveTwinError(f"Cannot clear the cache: {unwritable(folder, error)}") from error
