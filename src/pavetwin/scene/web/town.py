"""A town for browsers: a manifest with files made on demand, or a folder that any web server can serve."""

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from threading import Lock
from typing import Any, Final

from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing, writing_folder
from pavetwin.plugins import load_plugins
from pavetwin.scene.buildings import FACADE_REPEAT_M
from pavetwin.scene.export import tiles_of
from pavetwin.scene.ground.styles import street_style
from pavetwin.scene.light import Light, centre_lonlat
from pavetwin.scene.scene import Scene
from pavetwin.scene.texture_cache import code_hash
from pavetwin.scene.values import TileKey, tile_at
from pavetwin.scene.web.packing import DEFECTS_TO_M, FACADE_STEPS, FORMAT, WEB_LEVELS, WebLevel
from pavetwin.scene.web.shared_files import LEAVES_CUT, facades_file, leaves_file, light_values, models_file
from pavetwin.scene.web.tiles import TileFiles
from pavetwin.workers import OnTick, WorkerPool
from pavetwin.world.cache import cached
from pavetwin.world.ground import Bounds
from pavetwin.world.model import World

MANIFEST: Final = "manifest.json"
MODELS, FACADES, LEAVES = "models.glb.gz", "facades.jpg", "leaves.png"
_TILE: Final = re.compile(r"(\d)/(-?\d{1,6})_(-?\d{1,6})\.glb\.gz")
_RELIEF: Final = re.compile(r"defects/(-?\d{1,6})_(-?\d{1,6})_(\d{1,4})\.glb\.gz")
_KEPT: Final = 3
"""Styles and versions of a world that are kept, the last used."""


class WebTown:
    """The files of a scene for browsers. A file is made on first request; a world, its defects, a seed, a
    style and a version of the program have the same bytes always."""

    def __init__(self, scene: Scene, *, bounds: Bounds | None = None, folder: Path | None = None) -> None:
        """Args:
        bounds: west, south, east, north in metres: only the tiles that meet them.
        folder: where files are kept; in the cache when not given.

        Raises:
            PaveTwinError: there is no street.
        """
        self.scene = scene
        self._bounds = bounds
        self._lock = Lock()
        self._folder = folder

    @cached_property
    def digest(self) -> str:
        """Hash of all that the files depend on."""
        world = self.scene.world
        style = repr(street_style(self.scene.style))
        parts = (FORMAT, world.content_hash, world.defects_hash, self.scene.seed, style, code_hash())
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    @cached_property
    def keys(self) -> tuple[TileKey, ...]:
        """The tiles of the scene that are shown."""
        return tiles_of(self.scene, self._bounds)

    @cached_property
    def squares(self) -> tuple[tuple[TileKey, ...], ...]:
        """The squares of each level. All levels cover the same land: what lies under the coarsest ones."""
        side = WEB_LEVELS[-1].side
        coarse = sorted({(column // side, row // side) for column, row in self.keys})
        fine = [
            (column * side + east, row * side + north)
            for column, row in coarse
            for north in range(side)
            for east in range(side)
        ]
        return tuple(tuple(coarse) if level.side == side else tuple(sorted(fine)) for level in WEB_LEVELS)

    def names(self, near: tuple[float, float] | None = None) -> Sequence[str]:
        """All files but the manifest: those that all tiles share, then tiles from the coarsest level to the finest, of
        each level those nearest to a point (the base unless given) first."""
        x, y = near or (self.scene.world.base.x, self.scene.world.base.y)
        found = [MODELS, FACADES, LEAVES]
        for level in reversed(WEB_LEVELS):
            found += [tile_name(level, key) for key in self._nearest(level, x, y)]
        for key in self._nearest(WEB_LEVELS[0], x, y):
            found += [f"defects/{key[0]}_{key[1]}_{part}.glb.gz" for part in range(self._files.parts(key))]
        return found

    def file(self, name: str) -> bytes:
        """A file by its name: from the cache, else made.

        Raises:
            KeyError: there is none of that name.
        """
        make = self._maker(name)
        path = self.folder / name
        with suppress(OSError):
            return path.read_bytes()
        with self._lock:
            made = make()
        with suppress(PaveTwinError), writing(path) as temporary:
            temporary.write_bytes(made)
        return made

    def manifest(self, conditions: Conditions | None = None) -> dict[str, Any]:
        """The manifest, which a client reads first; `bytes` is None where a file has not been made.

        Raises:
            PaveTwinError: the sun is below the horizon under these conditions.
        """
        world = self.scene.world
        levels = [
            {
                "level": level.number,
                "side_m": level.side_m,
                "error_m": level.error_m,
                "to_m": level.to_m if level is not WEB_LEVELS[-1] else None,
                "tiles": [self._entry(level, key) for key in keys],
            }
            for level, keys in zip(WEB_LEVELS, self.squares, strict=True)
        ]
        reliefs = {f"{key[0]}_{key[1]}": self._files.parts(key) for key in self.squares[0] if self._files.parts(key)}
        west, south, east, north = world.carriageway.bounds
        return {
            "format": FORMAT,
            "world": world.name,
            "digest": self.digest,
            "seed": self.scene.seed,
            "axes": "x north, y up, z east; metres of the world frame",
            "bounds": [round(value, 2) for value in (west, south, east, north)],
            "base": [round(world.base.x, 2), round(world.base.y, 2)],
            "levels": levels,
            "defects": {"to_m": DEFECTS_TO_M, "parts": reliefs},
            "models": {"file": MODELS, "bytes": self._bytes(MODELS)},
            "facades": {
                "file": FACADES,
                "bytes": self._bytes(FACADES),
                "repeat_m": FACADE_REPEAT_M,
                "steps": FACADE_STEPS,
            },
            "leaves": {"file": LEAVES, "bytes": self._bytes(LEAVES), "cut": LEAVES_CUT},
            "light": light_values(self.light(conditions or Conditions())),
        }

    def light(self, conditions: Conditions) -> Light:
        """The light over the town.

        Raises:
            PaveTwinError: the sun is below the horizon.
        """
        longitude, latitude = centre_lonlat(self.scene.world)
        return Light.of(conditions, latitude_deg=latitude, longitude_deg=longitude)

    @cached_property
    def folder(self) -> Path:
        """Folder of the files, named by what they depend on; few of other styles and versions are kept."""
        if self._folder is not None:
            return self._folder
        path = cached(self.scene.world, f"web/{self.digest}")
        with suppress(OSError):
            path.mkdir(parents=True, exist_ok=True)
            path.touch()
            others = sorted(path.parent.iterdir(), key=lambda each: -each.stat().st_mtime_ns)
            for old in others[_KEPT:]:
                shutil.rmtree(old, ignore_errors=True)
        return path

    @cached_property
    def _files(self) -> TileFiles:
        return TileFiles(self.scene)

    @cached_property
    def _tops(self) -> dict[TileKey, float]:
        """The greatest height of what stands on each tile."""
        tops: dict[TileKey, float] = {}
        standing = [(each.polygon.centroid, each.height_m) for each in self.scene.world.buildings]
        standing += [(each.position, each.height_m) for each in self.scene.world.furniture]
        for point, height in standing:
            key = tile_at(point.x, point.y)
            tops[key] = max(tops.get(key, 0.0), height)
        return tops

    def _maker(self, name: str) -> Callable[[], bytes]:
        shared = {
            MODELS: lambda: models_file(self.scene),
            FACADES: lambda: facades_file(self.scene)[0],
            LEAVES: leaves_file,
        }
        if name in shared:
            return shared[name]
        if match := _TILE.fullmatch(name):
            number, column, row = (int(value) for value in match.groups())
            if number < len(WEB_LEVELS) and (column, row) in self._known[number]:
                return lambda: self._files.tile(WEB_LEVELS[number], (column, row))
        if match := _RELIEF.fullmatch(name):
            column, row, part = (int(value) for value in match.groups())
            if (column, row) in self._known[0] and part < self._files.parts((column, row)):
                return lambda: self._files.relief((column, row), part)
        raise KeyError(name)

    @cached_property
    def _known(self) -> tuple[frozenset[TileKey], ...]:
        return tuple(frozenset(keys) for keys in self.squares)

    def _nearest(self, level: WebLevel, x_m: float, y_m: float) -> Sequence[TileKey]:
        def away(key: TileKey) -> tuple[float, TileKey]:
            east, north = ((place + 0.5) * level.side_m for place in key)
            return (east - x_m) ** 2 + (north - y_m) ** 2, key

        return sorted(self.squares[level.number], key=away)

    def _entry(self, level: WebLevel, key: TileKey) -> list[Any]:
        """Column, row, the bounds west, south, east, north and top in metres, and bytes."""
        parts = list(_under(level, key))
        boxes = [self.scene.extent(part) for part in parts]
        west, south = min(box[0] for box in boxes), min(box[1] for box in boxes)
        east, north = max(box[2] for box in boxes), max(box[3] for box in boxes)
        top = max(self._tops.get(part, 0.0) for part in parts)
        rounded = [round(value, 1) for value in (west, south, east, north, top + 1.0)]
        return [*key, *rounded, self._bytes(tile_name(level, key))]

    def _bytes(self, name: str) -> int | None:
        try:
            return (self.folder / name).stat().st_size
        except OSError:
            return None


def tile_name(level: WebLevel, key: TileKey) -> str:
    """The file of a tile."""
    return f"{level.number}/{key[0]}_{key[1]}.glb.gz"


def _under(level: WebLevel, key: TileKey) -> Iterator[TileKey]:
    """The tiles of the scene in a square."""
    column, row = key[0] * level.side, key[1] * level.side
    return ((column + east, row + north) for north in range(level.side) for east in range(level.side))


RUN: Final = 12  # Files that a process makes in one task: neighbours, which share maps and defects


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
            start = partial(_start, scene.world, scene.seed, scene.style, bounds, plugins)
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
    world: World, seed: int, style: str, bounds: Bounds | None, plugins: tuple[str, ...], on_tick: OnTick
) -> Callable[[tuple[str, ...]], None]:
    """In a worker process: makes files into the cache."""
    load_plugins(plugins)
    town = WebTown(Scene(world, seed=seed, style=style), bounds=bounds)

    def make(run: tuple[str, ...]) -> None:
        for name in run:
            town.file(name)
            on_tick()

    return make
