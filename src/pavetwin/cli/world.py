"""`pavetwin world …`: build, show, draw and export worlds."""

import os
from collections import Counter
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.cli.options import (
    DaylightOptions,
    Parking,
    Plugins,
    WorldFolder,
    grouped,
    paths_of,
)
from pavetwin.errors import PaveTwinError, about, naming

if TYPE_CHECKING:
    from rich.table import Table

    from pavetwin.cli.options import ParkedVehicles as ParkedShare
    from pavetwin.draw.navmesh_map import NavMeshReport
    from pavetwin.scene.export import TrafficSnapshot
    from pavetwin.scene.scene import Scene
    from pavetwin.traffic.parked import ParkedVehicles
    from pavetwin.world.build import BuildRecord
    from pavetwin.world.model import Segment, World


app = Commands(help="Build, inspect and draw worlds: streets, buildings, furniture, defects.", no_args_is_help=True)


@app.command()
def build(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the new world.")],
    source: Annotated[
        Path | None, typer.Argument(help="A map: .osm, .osm.gz, .osm.pbf, or a SUMO network: .net.xml.")
    ] = None,
    generate: Annotated[str | None, typer.Option(help="Generate streets: town, grid, spider or random.")] = None,
    seed: Annotated[int, typer.Option(help="Random seed of the world; 0 is valid.")] = 0,
    segment_length_m: Annotated[float, typer.Option("--segment-length", help="Longest segment, in metres.")] = 135.0,
    population: Annotated[
        str | None,
        typer.Option(
            "--damage",
            metavar="POPULATION",
            help="Numbers, classes, sizes and positions of the defects: survey (as in surveys of city streets), "
            "paper (30 per segment), or a YAML file of your own.",
            show_default="survey",
        ),
    ] = None,
    per_segment: Annotated[
        float | None,
        typer.Option(
            "--defects-per-segment", help="The same number of defects on every segment, in place of the population's."
        ),
    ] = None,
    per_100_m2: Annotated[
        float | None,
        typer.Option("--defects-per-100-m2", help="Mean number of defects per 100 m², instead of the population's."),
    ] = None,
    defect_mix: Annotated[
        str | None,
        typer.Option(
            metavar="CLASS=WEIGHT,…",
            help="Classes of the defects and their weights, as in pothole=2,single_crack=1; default: those of "
            "the population.",
        ),
    ] = None,
    anchor: Annotated[
        str | None, typer.Option(metavar="LAT,LON", help="Place of the origin of a SUMO network without a projection.")
    ] = None,
    left_hand: Annotated[bool, typer.Option("--left-hand", help="Traffic keeps left (OSM maps only).")] = False,
    parking_rule: Annotated[
        str,
        typer.Option(
            metavar="RULE",
            help="Parking rule where the map has no parking: europe, north_america, a rule.yaml of your own, or none.",
        ),
    ] = "europe",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing world.")] = False,
) -> None:
    """Build a world from a map, a SUMO network, or generated streets.

    \b
    pavetwin world build berlin.osm.pbf -o worlds/berlin
    pavetwin world build my.net.xml -o worlds/mine --anchor 48.14,11.58
    pavetwin world build --generate town --seed 7 -o worlds/town
    pavetwin world build --generate town -o worlds/published --damage paper --parking-rule none
    pavetwin world build --generate town -o worlds/holes --defects-per-100-m2 2 --defect-mix pothole=3,single_crack=1
    pavetwin world build seattle.osm --parking-rule north_america -o worlds/seattle
    """
    from pavetwin.defects import DefectOptions
    from pavetwin.defects.placement import build_folder
    from pavetwin.world.build import BuildOptions
    from pavetwin.world.generate import network_kind
    from pavetwin.world.georeference import parse_anchor

    if (source is None) == (generate is None):
        raise PaveTwinError(
            "Give either a SOURCE file or --generate, for example `pavetwin world build town.osm -o town` "
            "or `pavetwin world build --generate town -o town`."
        )
    values: dict[str, Any] = {"seed": seed, "segment_length_m": segment_length_m, "left_hand": left_hand}
    values["parking_rule"] = parking_rule
    if anchor is not None:
        values["anchor"] = parse_anchor(anchor)
    options = BuildOptions.parse(values, where="")
    asked = {"population": population, "per_segment": per_segment, "per_100_m2": per_100_m2}
    given = {name: value for name, value in asked.items() if value is not None}
    mix = {} if defect_mix is None else {"mix": _weights(defect_mix)}
    defects = DefectOptions.parse({**given, **mix}, where="")
    chosen = source if source is not None else network_kind(generate or "")
    with progress("Building the world") as report, naming({"`defects`": "--defect-mix"}):
        world, record = build_folder(
            chosen, output, options, defects, force=force, jobs=None, on_progress=lambda share, _what: report(share)
        )
    _print_summary(world, record)
    out.line(f"Written to {output}/ (world.gpkg opens in QGIS). Next: pavetwin world show {quote(str(output))}")


def _weights(text: str) -> dict[str, float]:
    """`pothole=2,single_crack=1` as weights by class.

    Raises:
        PaveTwinError: it is written differently.
    """
    pairs = [part.partition("=") for part in text.split(",")]
    try:
        return {name.strip(): float(weight) for name, _, weight in pairs}
    except ValueError:
        raise PaveTwinError(
            f"--defect-mix {text}: expected classes with weights, as in --defect-mix pothole=2,single_crack=1."
        ) from None


@app.command()
def info(
    world: WorldFolder,
    streets: Annotated[
        bool, typer.Option("--streets", help="List the streets with their segments, lengths and areas.")
    ] = False,
) -> None:
    """Show the contents and the source of a world.

    \b
    pavetwin world info worlds/berlin
    pavetwin world info worlds/berlin --streets
    """
    from pavetwin.world.store import load_record, load_world

    loaded = load_world(world)
    if streets:
        out.print(_streets_table(loaded))
        return
    _print_summary(loaded, load_record(world))


def _streets_table(world: "World") -> "Table":
    """One row per street: its name for `--segment`, and its extent."""
    from rich.table import Table
    from rich.text import Text

    streets: dict[str, list[Segment]] = {}
    for segment in world.segments:
        streets.setdefault(segment.street_name, []).append(segment)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("street", "segments", "length m", "area m²"):
        table.add_column(heading, justify="left" if heading in ("street", "segments") else "right", overflow="fold")
    for name, segments in sorted(streets.items()):
        length_m, area_m2 = sum(each.length_m for each in segments), sum(each.area_m2 for each in segments)
        ids = " ".join(each.id for each in segments)
        table.add_row(Text(name), Text(ids), f"{length_m:.0f}", f"{area_m2:.0f}")
    return table


def _print_summary(world: "World", record: "BuildRecord") -> None:
    from rich.table import Table

    table = Table(title=f"World {world.name}", show_header=False, title_justify="left")
    for name, value in _summary(world, record):
        table.add_row(name, value)
    out.print(table)


def _summary(world: "World", record: "BuildRecord") -> list[tuple[str, str]]:
    """Rows of the table: names and values."""
    from pavetwin.config.mission import UavSettings
    from pavetwin.defects.placement import PLACED
    from pavetwin.navigation.take_off import with_roadside_base
    from pavetwin.world.model import LaneKind
    from pavetwin.world.osm import paving_words
    from pavetwin.world.segments import outside_words

    lon, lat = world.georeference.to_wgs84((world.base.x, world.base.y))
    roadside = with_roadside_base(world, UavSettings().radius_m).base
    take_off = "{1:.5f}, {0:.5f}".format(*world.georeference.to_wgs84((roadside.x, roadside.y)))
    mapped = record.mapped
    lights = {thing.controller for thing in world.furniture if thing.controller}
    kinds = Counter(thing.kind.value for thing in world.furniture)
    classes = Counter(defect.kind for defect in world.defects)
    area = sum(segment.area_m2 for segment in world.segments)
    length = sum(segment.length_m for segment in world.segments)
    houses = mapped.get("buildings", 0)
    rows = [
        ("source", f"{record.source}, seed {record.options.seed}"),
        ("place", f"EPSG:{world.georeference.epsg}, base at {lat:.5f}, {lon:.5f}"),
        ("take-off", f"{take_off}, next to the carriageway; preset paper: at the base"),
        ("segments", f"{len(world.segments)} ({length / 1000:.2f} km, {area:.0f} m²)"),
        ("not inspected", outside_words(world)),
        ("lanes", f"{world.length_km(LaneKind.DRIVING):.2f} km"),
        ("sidewalks", f"{world.length_km(LaneKind.SIDEWALK):.2f} km"),
        ("junctions", f"{len(world.junctions)}, {len(world.crossings)} crossings, {len(lights)} traffic lights"),
        ("buildings", _of_map(len(world.buildings), houses)),
    ]
    rows += [(name.replace("_", " ") + "s", _of_map(kinds[name], mapped.get(name, 0))) for name in sorted(kinds)]
    rows += _parking_rows(world)
    if lost := record.left_out.streets:
        streets = "1 street" if lost == 1 else f"{lost} streets"
        rows.append(("left out", f"{streets} ({record.left_out.length_m:.0f} m) not connected to the rest"))
    shares = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in sorted(classes.items()))
    rows.append(("defects", f"{len(world.defects)}" + (f" ({shares}); {PLACED}" if shares else "")))
    if paved := paving_words(record.paving_m2):
        rows.append(("pavement", paved))
    rows.append(("content", f"{world.content_hash[:12]}, defects {world.defects_hash[:12]}"))
    return rows


def _parking_rows(world: "World") -> list[tuple[str, str]]:
    """Parking places by source, orientation, and share on the carriageway."""
    from pavetwin.world.parking.places import on_carriageway

    if not world.parking:
        return [("parking places", "0")]
    words = {"tagged": "from tags of streets", "area": "from areas along streets", "rule": "by rule"}
    sources = Counter(place.source.value for place in world.parking)
    orientations = Counter(place.orientation.value for place in world.parking)
    origins = [f"{sources[name]} {text}" for name, text in words.items() if sources[name]]
    shares = on_carriageway(world)
    wholly, off = int((shares > 0.95).sum()), int((shares < 0.05).sum())
    return [
        ("parking places", f"{len(world.parking)} ({', '.join(origins)})"),
        ("", ", ".join(f"{count} {name}" for name, count in sorted(orientations.items()))),
        ("", f"{wholly} on the carriageway, {len(shares) - wholly - off} partly, {off} off it"),
    ]


def _of_map(total: int, mapped: int) -> str:
    return f"{total} ({mapped} from the source, {total - mapped} by rule)"


SEGMENT_AROUND_M = 25.0
"""Surroundings of a segment that an export includes."""


@app.command()
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
    detail: Annotated[str | None, typer.Option(help="Level of detail: low, medium or high; default: medium.")] = None,
    texel_m: Annotated[
        float | None,
        typer.Option("--texel", help="Size of ground texels in metres; default: by the level of detail."),
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option("--traffic", metavar="FILE.parquet", help="A recording, for traffic at one moment."),
    ] = None,
    at: Annotated[
        float | None, typer.Option(help="That moment, in seconds from the start of the recording; default: 0.")
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
    out.line(f"Written to {target}: {made.bytes / 1e6:.1f} MB; {held}; {made.texel_m * 100:g} cm per texel.")


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
    """Parked vehicles of the mix of the traffic; None unless requested."""
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


@app.command()
def show(
    world: WorldFolder,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Image file: .png, .svg or .pdf; default WORLD/map.png, or WORLD/condition.png."
        ),
    ] = None,
    ids: Annotated[bool, typer.Option("--ids", help="Write the segments' ids and mark where they end.")] = False,
    condition: Annotated[
        bool,
        typer.Option("--condition", help="Draw the true condition instead: defects per 100 m² by segment."),
    ] = False,
    html: Annotated[bool, typer.Option("--html", help="Also write an interactive page next to the image.")] = False,
) -> None:
    """Draw the map of a world.

    \b
    pavetwin world show worlds/berlin
    pavetwin world show worlds/berlin --ids --html -o berlin.png
    pavetwin world show worlds/berlin --condition
    """
    from pavetwin.config.mission import UavSettings
    from pavetwin.draw.condition_maps import save_condition_map
    from pavetwin.draw.world_html import save_world_html
    from pavetwin.draw.world_map import save_world_map
    from pavetwin.navigation.take_off import with_roadside_base
    from pavetwin.world.store import load_world

    if condition and (ids or html):
        raise PaveTwinError("--condition draws a separate map; omit --ids and --html.")
    loaded = with_roadside_base(load_world(world), UavSettings().radius_m)
    picture = output if output is not None else world / ("condition.png" if condition else "map.png")
    with progress("Drawing the map") as report:
        if condition:
            save_condition_map(loaded, picture)
            left_out = []
        else:
            left_out = save_world_map(loaded, picture, ids=ids)
        report(0.7)
        if html:
            save_world_html(loaded, picture.with_suffix(".html"))
        report(1.0)
    drawn = f"Drawn to {picture}"
    if html:
        drawn += f", and to {picture.with_suffix('.html')} (open it in a browser; it needs no network)"
    out.line(f"{drawn}.")
    note_fonts(loaded)
    if left_out:
        out.line(
            f"There was no room for {len(left_out)} of {len(loaded.segments)} ids; the page of --html has them all."
        )


@app.command()
def navmesh(
    world: WorldFolder,
    altitude_m: Annotated[float, typer.Option("--altitude", help="Metres above ground.")] = 10.0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Image file: .png, .svg or .pdf; default WORLD/navmesh-10m.png."),
    ] = None,
    geopackage: Annotated[
        Path | None, typer.Option(metavar="FILE.gpkg", help="Also save the polygons, for QGIS.")
    ] = None,
) -> None:
    """Bake the NavMesh at an altitude and draw its polygons.

    \b
    pavetwin world navmesh worlds/berlin --altitude 6
    pavetwin world navmesh worlds/berlin --altitude 15 -o mesh.png --geopackage mesh.gpkg
    """
    from pavetwin.config import load_settings
    from pavetwin.config.mission import check_altitude
    from pavetwin.draw.navmesh_map import bake, save_navmesh_map
    from pavetwin.navigation.navmesh import save_geopackage
    from pavetwin.world.store import load_world

    check_altitude(altitude_m)
    if geopackage is not None and geopackage.suffix.lower() != ".gpkg":
        raise PaveTwinError(f"--geopackage {geopackage}: end its name in .gpkg.")
    settings = load_settings("default")
    loaded = load_world(world)
    picture = output if output is not None else world / f"navmesh-{altitude_m:g}m.png"
    with progress("Baking the NavMesh") as report:
        baked = bake(loaded, altitude_m, settings.uav.radius_m)
        report(0.5)
        save_navmesh_map(baked, picture)
        if geopackage is not None:
            save_geopackage(baked.mesh, loaded, geopackage)
        report(1.0)
    _print_navmesh(baked, settings.uav.radius_m)
    also = f" and its polygons saved to {geopackage}" if geopackage is not None else ""
    out.line(f"Drawn to {picture}{also}.")
    note_fonts(loaded)


def _print_navmesh(baked: "NavMeshReport", radius_m: float) -> None:
    from rich.table import Table

    names = [segment.id for segment, ok in zip(baked.world.segments, baked.reachable, strict=True) if not ok]
    lost = f"; not {', '.join(names[:8])}{' …' if len(names) > 8 else ''}" if names else ""
    table = Table(
        title=f"NavMesh of {baked.world.name} at {baked.altitude_m:g} m", show_header=False, title_justify="left"
    )
    table.add_row("polygons", f"{len(baked.polygons)} convex")
    table.add_row("area", f"{baked.mesh.area_m2():.0f} m²")
    table.add_row("agent radius", f"{radius_m:g} m")
    table.add_row("obstacles", f"{len(baked.obstacles)} reach this altitude")
    reached = sum(baked.reachable)
    table.add_row("in reach", f"{reached} of {len(baked.reachable)} segments ({baked.share_reachable:.0%}){lost}")
    table.add_row("baked in", f"{baked.seconds:.2f} s")
    out.print(table)
