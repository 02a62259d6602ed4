"""A world as one binary glTF file: ground, defects, buildings, furniture, parked vehicles, traffic at one moment."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import shapely

from pavetwin._core import __version__
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.scene.export.detail import USUAL, Estimate, estimated, level_named
from pavetwin.scene.export.glb_parts import Job, SceneWriter, TilePiece, make_pieces
from pavetwin.scene.glb import LARGEST, GlbWriter
from pavetwin.scene.scene import Scene, keys_of
from pavetwin.scene.values import TILE_M, Instance, TileKey, tile_at, tile_bounds
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.world.ground import Bounds

LEAST_TILES: Final = 12  # Start-up time of a process: making the world's plan and textures takes as long
AROUND_M: Final = 40.0  # Land farther than this from any street is left out


@dataclass(frozen=True, slots=True)
class TrafficSnapshot:
    """Traffic of a recording at one time."""

    recording: Recording
    time_s: float


@dataclass(frozen=True, slots=True)
class ExportSummary:
    """Contents of an exported file."""

    tiles: int
    defects: int
    buildings: int
    agents: int
    """Parked vehicles too."""
    nodes: int
    bytes: int
    texel_m: float


def tiles_of(scene: Scene, bounds: Bounds | None = None) -> tuple[TileKey, ...]:
    """The tiles to be exported: all within `AROUND_M` of a street, of those that meet the bounds (west, south, east,
    north, metres).

    Raises:
        PaveTwinError: there are none.
    """
    roads = scene.world.carriageway
    near = roads.buffer(AROUND_M)
    area = near if bounds is None else near.intersection(shapely.box(*bounds))
    if roads.is_empty:
        raise PaveTwinError(f"The world '{scene.world.name}' has no streets, so there is nothing to export.")
    if area.is_empty:
        west, south, east, north = (round(value) for value in roads.bounds)
        raise PaveTwinError(
            f"There are no streets within these bounds; the world '{scene.world.name}' lies within "
            f"{west},{south},{east},{north} (west, south, east, north in metres)."
        )
    shapely.prepare(area)
    squares = {key: shapely.box(*tile_bounds(key)) for key in keys_of(area.bounds)}
    return tuple(key for key, square in squares.items() if area.intersects(square) and not area.touches(square))


def estimate(
    scene: Scene, keys: Sequence[TileKey], *, detail: str = USUAL, texel_m: float | None = None, jobs: int = 1
) -> Estimate:
    """Size and time of an export of these tiles.

    Raises:
        PaveTwinError: the level of detail is not known, or the texel size is out of range.
    """
    level = level_named(detail)
    defects = len({number for key in keys for number in scene.holes_on(key)})
    texel = level.texel_of(len(keys)) if texel_m is None else texel_m
    return estimated(level, texel, len(keys), defects, jobs_for(keys, jobs))


def jobs_for(keys: Sequence[TileKey], jobs: int) -> int:
    """How many of `jobs` processes are worth starting for these tiles: each makes the world's plan again."""
    return max(1, min(jobs, len(keys) // LEAST_TILES))


def export_scene(
    scene: Scene,
    target: str | Path,
    *,
    bounds: Bounds | None = None,
    detail: str = USUAL,
    texel_m: float | None = None,
    moment: TrafficSnapshot | None = None,
    parked: ParkedVehicles | None = None,
    jobs: int = 1,
    plugins: tuple[str, ...] = (),
    on_progress: Callable[[float], None] = lambda _: None,
) -> ExportSummary:
    """Write a scene to a .glb file, whole or not at all.

    The file's origin is the centre of its contents, stored as `extras.origin_m` of the asset.

    Args:
        target: a path that ends in .glb.
        bounds: west, south, east, north in metres of the world frame; everything when not given. Tiles are whole.
        detail: low, medium or high, see `LEVELS`.
        texel_m: side of a texel of the ground's images; the level's when not given.
        moment: traffic to be shown.
        parked: vehicles in the world's parking places to be shown.
        jobs: number of processes; it does not change the file.
        plugins: files that register the world's classes of defects, for those processes.
        on_progress: called with the share done.

    Raises:
        PaveTwinError: the name has another suffix, the level of detail is not known, the texel size is out of range,
            the bounds hold no street, or the file would be too large for the format or cannot be written.
    """
    target = Path(target)
    if target.suffix.lower() != ".glb":
        raise PaveTwinError(f"'{target}' should end in .glb: the scene is written as one binary glTF file.")
    keys = tiles_of(scene, bounds)
    if jobs < 1:
        raise PaveTwinError(f"`jobs` {jobs}: at least one process must make the tiles.")
    level = level_named(detail)
    texel_m = level.texel_of(len(keys)) if texel_m is None else texel_m
    if (size := estimate(scene, keys, detail=detail, texel_m=texel_m).bytes) > LARGEST:
        raise PaveTwinError(
            f"The file would have about {size / 1e9:.1f} GB, and binary glTF ends at 4.3 GB; take a coarser `texel_m` "
            f"than {texel_m:g} or fewer streets with `bounds`."
        )
    with writing(target) as temporary, tempfile.TemporaryFile(dir=target.parent) as spool:
        writer = GlbWriter(spool)
        columns, rows = zip(*keys, strict=True)
        middle = ((min(columns) + max(columns) + 1) * TILE_M / 2, (min(rows) + max(rows) + 1) * TILE_M / 2)
        parts = SceneWriter(writer, scene.models, scene.facade_textures, middle, scene.world.defects)
        roots = []
        defects: set[int] = set()
        made = 0

        def write(piece: TilePiece) -> None:
            roots.append(parts.tile(piece))
            defects.update(patch.label for patch in piece.patches)

        def on_tile() -> None:
            nonlocal made
            made += 1
            on_progress(min(made, len(keys)) / (len(keys) + 1))

        make_pieces(scene, keys, Job(texel_m, level, plugins), jobs_for(keys, jobs), write, on_tile)
        agents = _agents(scene, keys, moment, parked)
        roots += [parts.instance(instance) for instance in agents]
        with temporary.open("wb") as file:
            asset = {
                "generator": f"PaveTwin {__version__}",
                "extras": {
                    "world": scene.world.name,
                    "seed": scene.seed,
                    "origin_m": list(middle),
                    "detail": detail,
                    "texel_m": texel_m,
                },
            }
            writer.finish(file, spool, roots, asset)
        on_progress(1.0)
    return ExportSummary(
        tiles=len(keys),
        defects=len(defects),
        buildings=sum(len(scene.buildings_on(key)) for key in keys),
        agents=sum(instance.label > 0 for instance in agents),
        nodes=len(writer.nodes),
        bytes=target.stat().st_size,
        texel_m=texel_m,
    )


def _agents(
    scene: Scene, keys: Sequence[TileKey], moment: TrafficSnapshot | None, parked: ParkedVehicles | None
) -> list[Instance]:
    """Agents, parked vehicles and signal heads on the tiles."""
    found = scene.agents(moment.recording if moment else None, moment.time_s if moment else 0.0)
    found += () if parked is None else scene.parked(parked)
    on = set(keys)
    return [instance for instance in found if tile_at(*instance.transform[:2, 3]) in on]
