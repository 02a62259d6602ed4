"""`pavetwin world export`: a world as one file that Blender and web pages open, or as tiles for browsers."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.options import (
    DaylightOptions,
    Parking,
    Plugins,
    WorldFolder,
    grouped,
    paths_of,
)
from pavetwin.errors import PaveTwinError, about

if TYPE_CHECKING:
    from pavetwin.cli.options import ParkedVehicles as ParkedShare
    from pavetwin.scene.export import TrafficSnapshot
    from pavetwin.scene.scene import Scene
    from pavetwin.traffic.parked import ParkedVehicles
    from pavetwin.world.model import World

SEGMENT_AROUND_M = 25.0
"""What is shown around a segment that is asked for."""


@grouped
def export(
    world: WorldFolder,
    target: Annotated[Path, typer.Argument(help="The file to write, ending in .glb; with --web a folder.")],
    daylight: DaylightOptions,
    web: Annotated[
        bool, typer.Option("--web", help="A folder of tiles that browsers load by distance, in place of one file.")
    ] = False,
    bounds: Annotated[
        str | None, typer.Option(metavar="W,S,E,N", help="Only this part: west, south, east, north in metres.")
    ] = None,
    segment: Annotated[
        str | None,
        typer.Option(metavar="ID|STREET", help='Only the surroundings of a segment or street: s0003, "Bell Lane".'),
    ] = None,
    detail: Annotated[
        str | None, typer.Option(help="Level of detail: low, medium or high; medium unless given.")
    ] = None,
    texel_m: Annotated[
        float | None,
        typer.Option("--texel", help="Size of ground texels in metres; by the level of detail unless given."),
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option("--traffic", metavar="FILE.parquet", help="A recording, for traffic at one moment."),
    ] = None,
    at: Annotated[
        float | None, typer.Option(help="That moment, in seconds from the recording's beginning; 0 unless given.")
    ] = None,
    parking: Parking = None,
    style: Annotated[
        str, typer.Option(metavar="NAME|FILE.yaml", help="Of the streets: varied, uniform, or a YAML file.")
    ] = "varied",
    seed: Annotated[
        int, typer.Option(help="Random seed of the appearance (colours, wear, leaves) and of parked vehicles.")
    ] = 0,
    plugins: Plugins = None,
    jobs: Annotated[int, typer.Option(help="Number of worker processes; the file does not depend on it.")] = min(
        4, os.cpu_count() or 1
    ),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only estimate the size and the time.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the folder of an earlier export.")] = False,
) -> None:
    """Write the scene as one binary glTF file: ground, defects, buildings, furniture, and traffic at a moment.

    \b
    pavetwin world export worlds/berlin berlin.glb
    pavetwin world export worlds/berlin berlin.glb --detail low --dry-run
    pavetwin world export worlds/berlin street.glb --segment s0003 --detail high
    pavetwin world export worlds/berlin rush.glb --traffic high.parquet --at 60
    pavetwin world export worlds/berlin night.glb --parking by-time --time 23:00
    pavetwin world export worlds/berlin web/berlin --web --time 17:30 --clouds 0.4
    """
    from pavetwin.plugins import load_plugins
    from pavetwin.scene.export import USUAL, estimate, export_scene, tiles_of
    from pavetwin.scene.scene import Scene
    from pavetwin.world.store import load_world

    if bounds is not None and segment is not None:
        raise PaveTwinError("Give either --bounds or --segment, not both.")
    paths = paths_of(plugins)
    load_plugins(paths)
    loaded = load_world(world)
    part = _segment_bounds(loaded, segment) if segment is not None else _parsed(bounds)
    if web:
        of_one_file = {"detail": detail, "texel": texel_m, "traffic": recording, "at": at, "parking": parking}
        of_one_file["dry-run"] = dry_run or None
        if wrong := [name for name, value in of_one_file.items() if value is not None]:
            raise PaveTwinError(f"--{wrong[0]} applies to exports to one file; leave out that or --web.")
        _to_folder(Scene(loaded, seed=seed, style=style), target, part, daylight, jobs, force, paths)
        return
    if daylight.clouds is not None or force:
        option = "force" if daylight.clouds is None else "clouds"
        raise PaveTwinError(f"`{option}` applies to exports with --web only.")
    detail = detail or USUAL
    moment = _moment(loaded, recording, at)
    parked = _parked(loaded, parking, daylight, seed, moment)
    scene = Scene(loaded, seed=seed, style=style)
    keys = tiles_of(scene, part)
    expected = estimate(scene, keys, detail=detail, texel_m=texel_m, jobs=jobs)
    out.line(
        f"{len(keys)} tiles of 32 m at {detail} detail: about {expected.bytes / 1e6:.0f} MB, "
        f"{_duration(expected.seconds)} on an idle machine."
    )
    if dry_run:
        return
    with progress(f"Exporting {len(keys)} tiles", lines=True) as report:
        made = export_scene(
            scene,
            target,
            bounds=part,
            detail=detail,
            texel_m=texel_m,
            moment=moment,
            parked=parked,
            jobs=jobs,
            plugins=paths,
            on_progress=report,
        )
    held = f"{made.tiles} tiles of 32 m, {made.defects} defects, {made.buildings} buildings"
    held += f", {made.agents} agents and parked vehicles" if made.agents else ""
    out.line(f"Written to {target}: {made.bytes / 1e6:.1f} MB; {held}; {made.texel_m * 100:g} cm a texel.")


def _to_folder(
    scene: "Scene",
    target: Path,
    bounds: tuple[float, float, float, float] | None,
    daylight: DaylightOptions,
    jobs: int,
    force: bool,
    plugins: tuple[str, ...],
) -> None:
    from pavetwin.config import Conditions
    from pavetwin.scene.web import export_web

    conditions = Conditions.model_validate(daylight.conditions())
    with progress("Exporting tiles", lines=True) as report:
        made = export_web(
            scene,
            target,
            bounds=bounds,
            conditions=conditions,
            jobs=jobs,
            replace=force,
            plugins=plugins,
            on_progress=report,
        )
    out.line(f"Written to {target}: {made.tiles} tiles in {made.files} files, {made.bytes / 1e6:.1f} MB.")


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{round(seconds, -1):.0f} s"


def _parsed(bounds: str | None) -> tuple[float, float, float, float] | None:
    if bounds is None:
        return None
    try:
        west, south, east, north = (float(value) for value in bounds.split(","))
    except ValueError:
        raise PaveTwinError(
            f"--bounds {bounds}: give four numbers, west,south,east,north in metres, for example 0,0,200,150."
        ) from None
    if not (west < east and south < north):
        raise PaveTwinError(f"--bounds {bounds}: west must be less than east, and south less than north.")
    return west, south, east, north


def _segment_bounds(world: "World", segment: str) -> tuple[float, float, float, float]:
    import shapely

    with about("segment"):
        surfaces = [each.polygon for each in world.segments_named(segment)]
    west, south, east, north = (float(value) for value in shapely.total_bounds(surfaces))
    return west - SEGMENT_AROUND_M, south - SEGMENT_AROUND_M, east + SEGMENT_AROUND_M, north + SEGMENT_AROUND_M


def _parked(
    world: "World",
    parking: "ParkedShare | None",
    daylight: DaylightOptions,
    seed: int,
    moment: "TrafficSnapshot | None",
) -> "ParkedVehicles | None":
    """Parked vehicles of the mix of the traffic; None unless they are asked for."""
    from pavetwin.config import Conditions
    from pavetwin.config.mission import ParkingSettings
    from pavetwin.traffic.demand import DEFAULT_MIX
    from pavetwin.traffic.parked import parked_vehicles

    conditions = daylight.conditions()
    if parking is None:
        if conditions:
            raise PaveTwinError(f"--{next(iter(conditions))}: add --parking, such as --parking by-time.")
        return None
    settings = ParkingSettings.model_validate(parking.settings())
    mix = moment.recording.origin.mix if moment else DEFAULT_MIX
    return parked_vehicles(world, settings, Conditions.model_validate(conditions), seed, mix)


def _moment(world: "World", file: Path | None, at: float | None) -> "TrafficSnapshot | None":
    from pavetwin.scene.export import TrafficSnapshot
    from pavetwin.traffic.recording_file import load_recording

    if file is None:
        if at is not None:
            raise PaveTwinError(f"--at {at:g}: add a recording, --traffic FILE.parquet.")
        return None
    at_s = at or 0.0
    with about("recording"):
        recording = load_recording(file, world)
    if not 0 <= at_s <= recording.duration_s:
        raise PaveTwinError(f"--at {at_s:g}: the recording lasts from 0 to {recording.duration_s:g} s.")
    return TrafficSnapshot(recording, at_s)
