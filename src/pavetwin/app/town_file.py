"""The files of the town in 3-D for the page, in the process that is kept for them."""

import json
from pathlib import Path
from typing import Any

from pavetwin.files import writing
from pavetwin.scene.scene import SCENE_SEED, Scene
from pavetwin.scene.web.town import MANIFEST, WebTown
from pavetwin.world.model import World

_kept: dict[str, WebTown] = {}
"""The town requested last."""


def town_file(world: World, name: str, folder: Path) -> dict[str, Any]:
    """Path of a file of a world's town, made on first request.

    Args:
        name: within the town, as its manifest names files.
        folder: for what is not kept in the cache.

    Returns:
        `path`, and `tag`, another whenever the bytes may be others; empty where there is no file of that name.

    Raises:
        PaveTwinError: there is no street, or the file cannot be written.
    """
    town = _town(world)
    if name == MANIFEST:
        content = json.dumps(town.manifest(), separators=(",", ":")).encode()
        return {"path": str(_written(content, folder / f"{town.digest}.json"))}
    try:
        content = town.file(name)
    except KeyError:
        return {}
    path = town.folder / name
    if not path.is_file():
        path = _written(content, folder / town.digest / name.replace("/", "-"))
    return {"path": str(path), "tag": town.digest}


def _town(world: World) -> WebTown:
    town = _kept.get("town")
    if town is None or town.scene.world is not world:
        town = _kept["town"] = WebTown(Scene(world, seed=SCENE_SEED))
    return town


def _written(content: bytes, path: Path) -> Path:
    with writing(path) as temporary:
        temporary.write_bytes(content)
    return path
