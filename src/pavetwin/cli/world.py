"""`pavetwin world …`: build, inspect and draw worlds."""

from collections import Counter
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli import world_export, world_maps
from pavetwin.cli.commands import Commands
from pavetwin.cli.console import out, progress
from pavetwin.cli.options import WorldFolder
from pavetwin.errors import PaveTwinError, naming

if TYPE_CHECKING:
    from rich.table import Table

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
    seed: Annotated[int, typer.Option(help="Random seed of the world; 0 is a seed like any other.")] = 0,
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
            help="Parking where the map has none: europe, north_america, a rule.yaml of your own, or none.",
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


app.command()(world_maps.show)
app.command()(world_maps.navmesh)
app.command()(world_export.export)


def _streets_table(world: "World") -> "Table":
    """Row of each street: its name for `--segment`, and its extent."""
    from rich.table import Table
    from rich.text import Text

    grouped: dict[str, list[Segment]] = {}
    for segment in world.segments:
        grouped.setdefault(segment.street_name, []).append(segment)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("street", "segments", "length m", "area m²"):
        table.add_column(heading, justify="left" if heading in ("street", "segments") else "right", overflow="fold")
    for name, segments in sorted(grouped.items()):
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
        rows.append(("left out", f"{streets} ({record.left_out.length_m:.0f} m) that no street joins to the rest"))
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
