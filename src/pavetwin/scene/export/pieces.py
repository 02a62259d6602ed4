"""What a file holds of each tile, made before it is written: by this process, or by several at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError
from pavetwin.plugins import load_plugins
from pavetwin.scene.export.baking import BakedTexture, bake_patch, bake_tile, jpeg
from pavetwin.scene.export.detail import PATCH_FINER, LevelOfDetail
from pavetwin.scene.ground.materials.compose import MapPyramids
from pavetwin.scene.model import Mesh, Tile, TileKey
from pavetwin.scene.scene import Scene
from pavetwin.workers import OnTick, WorkerPool
from pavetwin.world.model import World

RUN: Final = 6
"""Neighbouring tiles that a process makes in one task: they share patches at their borders."""


@dataclass(frozen=True)
class Picture:
    """A surface's pictures as JPEG files."""

    colour: bytes
    normal: bytes | None


@dataclass(frozen=True)
class PatchPiece:
    """A defect's patch, or the part of it that lies on one tile."""

    label: int
    mesh: Mesh
    transform: Float64Array
    """(4, 4) from the defect's frame to the world's."""
    picture: Picture


@dataclass(frozen=True)
class TilePiece:
    """One tile."""

    tile: Tile
    ground: Picture
    patches: tuple[PatchPiece, ...]


@dataclass(frozen=True)
class Job:
    """What every process must know."""

    texel_m: float
    level: LevelOfDetail
    plugins: tuple[str, ...] = ()
    """Files that register the world's classes of defects."""


def make_pieces(
    scene: Scene, keys: Sequence[TileKey], job: Job, jobs: int, write: Callable[[TilePiece], None], on_tile: OnTick
) -> None:
    """Make all tiles with `jobs` processes, and hand them to `write` in the order of `keys`.

    Raises:
        PaveTwinError: a process dies several times.
    """
    if jobs == 1:
        for key in keys:
            write(_piece(scene, key, job))
            on_tile()
        return
    runs = [tuple(keys[first : first + RUN]) for first in range(0, len(keys), RUN)]
    made: dict[tuple[TileKey, ...], list[TilePiece]] = {}
    waiting = iter([*runs, ()])
    due = next(waiting)

    def on_result(run: tuple[TileKey, ...], pieces: list[TilePiece]) -> None:
        nonlocal due
        made[run] = pieces
        while due in made:
            for piece in made.pop(due):
                write(piece)
            due = next(waiting)

    with WorkerPool(jobs, partial(_start, scene.world, scene.seed, scene.look, job), on_tile) as pool:
        pool.run(runs, on_result, give_up=_give_up)


def _start(
    world: World, seed: int, look: str, job: Job, on_tile: OnTick
) -> Callable[[tuple[TileKey, ...]], list[TilePiece]]:
    """In a worker process."""
    load_plugins(job.plugins)
    scene = Scene(world, seed=seed, look=look)

    def made(run: tuple[TileKey, ...]) -> list[TilePiece]:
        pieces = []
        for key in run:
            pieces.append(_piece(scene, key, job))
            on_tile()
        return pieces

    return made


def _give_up(run: tuple[TileKey, ...]) -> None:
    raise PaveTwinError(
        f"Processes that made the tiles from {run[0]} on died several times, perhaps for want of memory; give fewer "
        "`jobs`."
    )


def _piece(scene: Scene, key: TileKey, job: Job) -> TilePiece:
    tile, maps, level = scene.tile(key), MapPyramids.of(scene.maps(key)), job.level
    patches = tuple(
        PatchPiece(
            patch.label,
            patch.mesh if level.has_fine_defects else patch.coarse,
            patch.transform,
            _picture(bake_patch(patch, tile.origin, maps, job.texel_m * PATCH_FINER), level),
        )
        for patch in scene.patches_on(key)
    )
    return TilePiece(tile, _picture(bake_tile(tile, maps, job.texel_m), level), patches)


def _picture(baked: BakedTexture, level: LevelOfDetail) -> Picture:
    normal = jpeg(baked.normal, level.quality + 2, level.subsampling) if level.has_normals else None
    return Picture(jpeg(baked.colour, level.quality, level.subsampling), normal)
