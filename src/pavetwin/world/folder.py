"""The folder of a world: the names of its files, its description, and whether it may be written or read."""

from pathlib import Path
from shlex import quote
from typing import Any

from pavetwin.errors import PaveTwinError
from pavetwin.files import check_format, check_writable

DESCRIPTION, GEOPACKAGE, NETWORK = "world.yaml", "world.gpkg", "roads.net.xml"
FILES = (DESCRIPTION, GEOPACKAGE, NETWORK)

CACHE_VARIABLE = "PAVETWIN_CACHE"
"""Environment variable that names the folder of the cache, see `pavetwin.world.cache`."""

OSM_SUFFIXES = (".osm", ".osm.gz", ".osm.pbf")
NET_SUFFIXES = (".net.xml", ".net.xml.gz")
"""Suffixes of the sources of a world."""


def check_target(folder: str | Path, *, force: bool = False) -> None:
    """Refuse early where `save_world` would.

    Raises:
        PaveTwinError: something is there that may not be replaced, or nothing can be written there.
    """
    folder = Path(folder)
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        if not folder.is_dir() or not any((folder / name).exists() for name in FILES):
            raise PaveTwinError(f"'{folder}' exists and is not a world, so it is not replaced; choose another name.")
        if not force:
            raise PaveTwinError(f"The world '{folder}' exists already; choose another name, or replace it (`force`).")
    check_writable(folder / DESCRIPTION)


def check_world(folder: Path) -> None:
    """Refuse a folder that is not a world, in a fraction of the time that reading one takes.

    Raises:
        PaveTwinError: it does not exist, or a file of a world is missing in it.
    """
    if not folder.is_dir():
        suffix = next((end for end in (*NET_SUFFIXES, *OSM_SUFFIXES) if folder.name.lower().endswith(end)), "")
        target = folder.with_name(folder.name[: -len(suffix)] or "world") if suffix else folder
        source = quote(str(folder)) if suffix else "SOURCE"
        build = f"`pavetwin world build {source} --output {quote(str(target))}`"
        if suffix and folder.is_file():
            raise PaveTwinError(f"'{folder}' is a map, not a world yet; build one from it with {build}.")
        what = "is not a folder" if folder.exists() else "does not exist"
        raise PaveTwinError(f"The world '{folder}' {what}; make one with {build}.")
    missing = [name for name in FILES if not (folder / name).is_file()]
    if len(missing) == len(FILES):
        raise PaveTwinError(f"'{folder}' is not a world: it has no {DESCRIPTION}; {rebuild_hint(folder)}")
    if missing:
        raise PaveTwinError(
            f"The world '{folder}' is not complete: {', '.join(missing)} is missing; {rebuild_hint(folder)}"
        )


def read_description(folder: Path) -> dict[str, Any]:
    """The contents of `world.yaml`.

    Raises:
        PaveTwinError: as `check_world`; it cannot be read, or is of another version.
    """
    import yaml

    check_world(folder)
    try:
        description = yaml.safe_load((folder / DESCRIPTION).read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, OSError) as error:
        raise PaveTwinError(f"'{folder / DESCRIPTION}' cannot be read; {rebuild_hint(folder)}") from error
    if not isinstance(description, dict) or "format" not in description:
        raise PaveTwinError(f"'{folder / DESCRIPTION}' is damaged; {rebuild_hint(folder)}")
    check_format(description["format"], f"The world '{folder}'")
    return description


def rebuild_hint(folder: Path) -> str:
    """The end of a message about a world that cannot be read."""
    return f"build it again with `pavetwin world build SOURCE --output {quote(str(folder))} --force`."
