"""A town for browsers as a folder of files, which any web server can serve."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from pavetwin.config import Conditions
from pavetwin.files import writing_folder
from pavetwin.plugins import load_plugins
from pavetwin.scene.scene import Scene
from pavetwin.scene.web.town import MANIFEST, WebTown
from pavetwin.workers import OnTick, WorkerPool
from pavetwin.world.ground import Bounds
from pavetwin.world.model import World

RUN: Final = 12
"""Files that a process makes in one task: neighbours, which share maps and defects."""


@dataclass(frozen=True, slots=True)
class WebExport:
    """Contents of an exported folder."""

    tiles: int
    """Over all levels."""
    files: int
    bytes: int


def export_web(
    scene: Scene,
    target: Path,
    *,
    bounds: Bounds | None = None,
    conditions: Conditions | None = None,
    jobs: int = 1,
    replace: bool = False,
    plugins: tuple[str, ...] = (),
    on_progress: Callable[[float], None] = lambda _: None,
) -> WebExport:
    """Write all files of a town into a folder, whole or not at all.

    Args:
        bounds: west, south, east, north in metres; everything when not given.
        conditions: of the light.
        jobs: number of processes; it does not change the files.
        replace: whether an existing folder is replaced.
        plugins: files that register the world's classes of defects, for those processes.
        on_progress: called with the share done.

    Raises:
        PaveTwinError: the bounds hold no street, the sun is below the horizon, or the folder exists or cannot be
            written.
    """
    with writing_folder(target, replace=replace) as folder:
        town = WebTown(scene, bounds=bounds)
        town.light(conditions or Conditions())
        names = town.names()
        made = 0

        def on_file() -> None:
            nonlocal made
            made += 1
            on_progress(made / (len(names) + 1))

        if jobs > 1:
            runs = [tuple(names[first : first + RUN]) for first in range(0, len(names), RUN)]
            start = partial(_start, scene.world, scene.seed, scene.look, bounds, plugins)
            with WorkerPool(jobs, start, on_file) as pool:
                # What a process that died has left over is made below.
                pool.run(runs, lambda _run, _made: None, give_up=lambda _run: None)
        for name in names:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(town.file(name))
            if jobs == 1:
                on_file()
        (folder / MANIFEST).write_text(json.dumps(town.manifest(conditions), separators=(",", ":")), encoding="utf-8")
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return WebExport(sum(len(squares) for squares in town.squares), len(names) + 1, size)


def _start(
    world: World, seed: int, look: str, bounds: Bounds | None, plugins: tuple[str, ...], on_tick: OnTick
) -> Callable[[tuple[str, ...]], None]:
    """In a worker process: makes files into the cache."""
    load_plugins(plugins)
    town = WebTown(Scene(world, seed=seed, look=look), bounds=bounds)

    def make(run: tuple[str, ...]) -> None:
        for name in run:
            town.file(name)
            on_tick()

    return make
