"""`pavetwin plan …`: plans that a real drone flies."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli.arguments import NamingCommand
from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pavetwin.flightplan import FlightPlan, PlanFormat, Trigger
    from pavetwin.world.model import World

app = typer.Typer(help="Take a mission to a real drone.", no_args_is_help=True)


@app.callback()
def _only_a_group() -> None:
    """A group, although it has one command."""


PlanFormats = Annotated[
    list[str] | None, typer.Option("--format", help="{planformats}; may be repeated. qgc unless given.")
]
TriggerName = Annotated[
    str, typer.Option(metavar="distance|time", help="What releases the camera: metres flown, or seconds.")
]
Drone = Annotated[
    str | None, typer.Option(help="For wpml: mavic3e, matrice30 or matrice350. The mission's own unless given.")
]
Highest = Annotated[
    float | None, typer.Option(metavar="METRES", min=0, help="Refuse a plan that goes higher above take-off.")
]
FromBuildings = Annotated[
    float, typer.Option(metavar="METRES", min=0, help="Refuse a plan that comes nearer to a building.")
]
NoFly = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Refuse a plan that enters one of these polygons (GeoJSON, GeoPackage …)."),
]


@app.command(cls=NamingCommand)
def export(
    folder: Annotated[
        Path, typer.Argument(metavar="MISSION|WORLD", help="Folder of a mission, or its mission.yaml; or of a world.")
    ],
    format_: PlanFormats = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; plan in that one unless given.")
    ] = None,
    trigger: TriggerName = "distance",
    drone: Drone = None,
    highest: Highest = None,
    from_buildings: FromBuildings = 0.0,
    no_fly: NoFly = None,
    segment: Annotated[
        list[str] | None,
        typer.Option(help="Of a world, a segment's id or a street's name; may be repeated. All unless given."),
    ] = None,
    order: Annotated[str | None, typer.Option(metavar="near|random", help="Of a world: near unless given.")] = None,
    altitude: Annotated[float | None, typer.Option(help="Of a world: metres above ground; 10 unless given.")] = None,
    aircraft: Annotated[
        str | None, typer.Option(metavar="NAME|FILE.yaml", help="Of a world: {aircraft}, or your own.")
    ] = None,
    base: Annotated[
        str | None, typer.Option(metavar="LAT,LON|x,y", help="Of a world: where to take off; as in fly unless given.")
    ] = None,
    preset: Annotated[str | None, typer.Option(help="Of a world: default or paper.")] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Of a world: override a setting.")
    ] = None,
) -> None:
    """Write a plan for QGroundControl, DJI Pilot 2 or Litchi, a file for each set of batteries.

    Of a mission that was flown; or of segments of a world, which need no mission: the plan of the policy baseline.

    \b
    pavetwin plan export missions/monday/baseline --format qgc
    pavetwin plan export missions/monday/baseline --format wpml --drone mavic3e --highest 50 --from-buildings 5
    pavetwin plan export missions/monday/baseline --format litchi --format csv --no-fly zones.geojson -o plans
    pavetwin plan export worlds/berlin --segment Sonnenallee --altitude 15 --format wpml -o sonnenallee

    Heights are above the take-off point. The pilot is responsible for the flight: check every plan before you fly it.
    """
    from pavetwin.flightplan import PlanLimits, check_limits, save_plan
    from pavetwin.flightplan.formats.plan_files import check_folder, remark_on_parts
    from pavetwin.mission.folder import mission_file
    from pavetwin.world.folder import DESCRIPTION

    released_by, formats = checked(trigger, drone, format_, no_fly)
    if output is not None:
        check_folder(output)
    chosen: dict[str, Any] = {
        **{"segment": segment, "order": order, "altitude": altitude, "aircraft": aircraft},
        **{"base": base, "preset": preset, "set": set_},
    }
    with progress("Planning") as tell:
        if (folder / DESCRIPTION).is_file():
            plan, world = _of_selection(folder, chosen, released_by, tell)
            target = output or folder / "plan"
        else:
            plan, world = _of_mission(folder, chosen, released_by)
            target = output or mission_file(folder).parent / "plan"
        limits = PlanLimits(highest, from_buildings, no_fly)
        check_limits(plan, world, limits, [each.most_waypoints for each in formats])
        files = save_plan(plan, target, formats)
    tell_plan(plan)
    if parts := remark_on_parts(files):
        out.line(parts)
    out.line(f"Written: {', '.join(map(str, files))}.")


def _of_mission(folder: Path, chosen: "Mapping[str, Any]", trigger: "Trigger") -> "tuple[FlightPlan, World]":
    """Raises:
    PaveTwinError: an option is for a world, or the mission cannot be read or has changed.
    """
    from pavetwin.flightplan import plan_of
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import check_unchanged, world_of

    former = MissionFolder(folder, other_policy=True)
    if given := [name for name, value in chosen.items() if value is not None]:
        raise PaveTwinError(f"--{given[0]} is for a world; '{folder}' is a mission, which says it.")
    world = world_of(former.spec.world)
    check_unchanged(former.spec.with_policy("baseline"), world)  # the track needs no file of its policy
    return plan_of(former, world, trigger=trigger), world


def _of_selection(
    folder: Path, chosen: "Mapping[str, Any]", trigger: "Trigger", tell: "Callable[[float], None]"
) -> "tuple[FlightPlan, World]":
    from pavetwin.config import load_settings
    from pavetwin.config.mission import check_altitude
    from pavetwin.flightplan import plan_of_selection
    from pavetwin.mission.planning import base_point
    from pavetwin.world.store import load_world

    given = {"altitude_m": chosen["altitude"], "aircraft": chosen["aircraft"]}
    if chosen["altitude"] is not None:
        check_altitude(chosen["altitude"])
    settings = load_settings(
        chosen["preset"] or "default",
        chosen["set"] or (),
        **{name: value for name, value in given.items() if value is not None},
    )
    world = load_world(folder)
    plan = plan_of_selection(
        world,
        settings,
        segments=chosen["segment"] or (),
        order=chosen["order"] or "near",
        base=base_point(chosen["base"], world),
        trigger=trigger,
        on_progress=tell,
    )
    return plan, world


def checked(
    trigger: str, drone: str | None, formats: list[str] | None, no_fly: Path | None
) -> "tuple[Trigger, list[PlanFormat]]":
    """What the options of plans name.

    Raises:
        PaveTwinError: there is no such trigger, drone, format or file.
    """
    from pavetwin.flightplan import PLAN_FORMATS, Trigger
    from pavetwin.flightplan.formats.wpml import drone_named
    from pavetwin.flightplan.limits import check_file

    if trigger not in list(Trigger):
        raise PaveTwinError(f"`trigger` {trigger}: expected {' or '.join(Trigger)}.")
    if drone is not None:
        drone_named(drone)
    if no_fly is not None:
        check_file(no_fly)
    return Trigger(trigger), [PLAN_FORMATS.get(name)(drone) for name in dict.fromkeys(formats or ["qgc"])]


def tell_plan(plan: "FlightPlan") -> None:
    """Print the flights of a plan, and what a pilot must know."""
    for number, flight in enumerate(plan.flights, 1):
        home = flight.home
        out.line(
            f"Flight {number}: {len(flight.waypoints)} waypoints, {flight.distance_m:.0f} m in about "
            f"{flight.duration_s / 60:.1f} min, up to {max(each.height_m for each in flight.waypoints):g} m above "
            f"take-off at {home.latitude:.6f},{home.longitude:.6f}."
        )
    by = f"{plan.spacing_m:.2g} m" if plan.trigger == "distance" else f"{plan.interval_s:g} s"
    out.line(f"A photograph every {by} on inspected legs, the camera straight down.")
    for remark in plan.remarks:
        out.line(remark)
    out.line(
        "The ground is taken as level and obstacles as mapped; wires and trees may be missing. The pilot is "
        "responsible: check the plan, the airspace and the permits, and keep the aircraft in sight."
    )
