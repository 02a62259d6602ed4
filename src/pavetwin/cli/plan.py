"""`pavetwin plan …`: plans that a real drone flies."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.arguments import NamingCommand
from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.flightplan import FlightPlan, PlanFormat, Trigger

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
    mission: Annotated[Path, typer.Argument(metavar="MISSION", help="Folder of a mission, or its mission.yaml.")],
    format_: PlanFormats = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; plan in the mission's unless given.")
    ] = None,
    trigger: TriggerName = "distance",
    drone: Drone = None,
    highest: Highest = None,
    from_buildings: FromBuildings = 0.0,
    no_fly: NoFly = None,
) -> None:
    """Write a mission as a plan for QGroundControl, DJI Pilot 2 or Litchi, a file for each set of batteries.

    \b
    pavetwin plan export missions/monday/baseline --format qgc
    pavetwin plan export missions/monday/baseline --format wpml --drone mavic3e --highest 50 --from-buildings 5
    pavetwin plan export missions/monday/baseline --format litchi --format csv --no-fly zones.geojson -o plans

    Heights are above the take-off point. The pilot is responsible for the flight: check every plan before you fly it.
    """
    from pavetwin.flightplan import PlanLimits, check_limits, plan_of, save_plan
    from pavetwin.flightplan.save import check_folder, remark_on_parts
    from pavetwin.mission.again import mission_file, read_mission
    from pavetwin.mission.inputs import check_unchanged, world_of

    released_by, formats = checked(trigger, drone, format_, no_fly)
    if output is not None:
        check_folder(output)
    with progress("Planning"):
        former = read_mission(mission_file(mission), other_policy=True)
        world = world_of(former.spec.world)
        check_unchanged(former.spec.with_policy("baseline"), world)  # the track needs no file of its policy
        plan = plan_of(former, world, trigger=released_by)
        check_limits(plan, world, PlanLimits(highest, from_buildings, no_fly))
        files = save_plan(plan, output or former.path.parent / "plan", formats)
    tell_plan(plan)
    if parts := remark_on_parts(files):
        out.line(parts)
    out.line(f"Written: {', '.join(map(str, files))}.")


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
