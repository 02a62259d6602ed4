"""`pavetwin world show` and `pavetwin world navmesh`: maps of a world and of its flyable area."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.cli.options import WorldFolder
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.draw.navmesh_map import NavMeshReport


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
    _print(baked, settings.uav.radius_m)
    also = f" and its polygons saved to {geopackage}" if geopackage is not None else ""
    out.line(f"Drawn to {picture}{also}.")
    note_fonts(loaded)


def _print(baked: "NavMeshReport", radius_m: float) -> None:
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
