"""`pavetwin plan …`: plans that a real drone flies."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.commands import Commands
from pavetwin.cli.console import out, progress
from pavetwin.cli.options import grouped, was_given
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from collections.abc import Callable

    from pavetwin.config import MissionSettings
    from pavetwin.flightplan import FlightPlan, PlanFormat, PlanLimits, Trigger
    from pavetwin.world.model import World

app = Commands(help="Take a mission to a real drone.", no_args_is_help=True)


@app.callback()
def _only_a_group() -> None:
    """A group, although it has one command."""


@dataclass(frozen=True)
class PlanOptions:
    """Plans."""

    formats: Annotated[
        list[str] | None, typer.Option("--format", help="{planformats}; may be repeated. Default: qgc.")
    ] = None
    trigger: Annotated[
        str, typer.Option(metavar="distance|time", help="Release of the camera: by metres flown, or by seconds.")
    ] = "distance"
    drone: Annotated[
        str | None, typer.Option(help="Drone for wpml: mavic3e, matrice30 or matrice350; default: that of the mission.")
    ] = None
    highest: Annotated[
        float | None, typer.Option(metavar="METRES", min=0, help="Refuse plans that exceed this height above take-off.")
    ] = None
    from_buildings: Annotated[
        float, typer.Option(metavar="METRES", min=0, help="Refuse plans that come closer to a building.")
    ] = 0.0
    no_fly: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Refuse plans that enter one of these polygons (GeoJSON, GeoPackage …)."),
    ] = None

    def checked(self) -> "tuple[Trigger, list[PlanFormat]]":
        """The trigger and the formats.

        Raises:
            PaveTwinError: a trigger, drone, format or file does not exist.
        """
        from pavetwin.flightplan import PLAN_FORMATS, Trigger
        from pavetwin.flightplan.formats.wpml import drone_named
        from pavetwin.flightplan.limits import check_file

        if self.trigger not in list(Trigger):
            raise PaveTwinError(f"`trigger` {self.trigger}: expected {' or '.join(Trigger)}.")
        if self.drone is not None:
            drone_named(self.drone)
        if self.no_fly is not None:
            check_file(self.no_fly)
        names = dict.fromkeys(self.formats or ["qgc"])
        return Trigger(self.trigger), [PLAN_FORMATS.get(name)(self.drone) for name in names]

    def limits(self) -> "PlanLimits":
        """Limits of a plan."""
        from pavetwin.flightplan import PlanLimits

        return PlanLimits(self.highest, self.from_buildings, self.no_fly)


@dataclass(frozen=True)
class SelectionOptions:
    """Plans of a world."""

    names: Annotated[
        list[str] | None,
        typer.Option("--segment", help="Id of a segment or name of a street; may be repeated. Default: all."),
    ] = None
    order: Annotated[str | None, typer.Option(metavar="near|random", help="Order of the segments; default: near.")] = (
        None
    )
    altitude_m: Annotated[float | None, typer.Option("--altitude", help="Metres above ground; default: 10.")] = None
    aircraft: Annotated[str | None, typer.Option(metavar="NAME|FILE.yaml", help="{aircraft}, or your own.")] = None
    base: Annotated[
        str | None, typer.Option(metavar="LAT,LON|x,y", help="Take-off place; default: as in `pavetwin fly`.")
    ] = None
    preset: Annotated[str | None, typer.Option(help="default or paper.")] = None
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated.")
    ] = None

    def settings(self) -> "MissionSettings":
        """Raises:
        PaveTwinError: a value does not fit.
        """
        from pavetwin.config import load_settings
        from pavetwin.config.mission import check_altitude

        if self.altitude_m is not None:
            check_altitude(self.altitude_m)
        given = {"altitude_m": self.altitude_m, "aircraft": self.aircraft}
        values = {name: value for name, value in given.items() if value is not None}
        return load_settings(self.preset or "default", self.overrides or (), **values)


@app.command()
@grouped
def export(
    context: typer.Context,
    folder: Annotated[
        Path, typer.Argument(metavar="MISSION|WORLD", help="Folder of a mission, or its mission.yaml; or of a world.")
    ],
    plans: PlanOptions,
    selection: SelectionOptions,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; default: plan in that folder.")
    ] = None,
) -> None:
    """Write a plan for QGroundControl, DJI Pilot 2 or Litchi, one file per set of batteries.

    The source is a flown mission, or a world, for a plan of its segments by the policy baseline.

    \b
    pavetwin plan export missions/monday/baseline --format qgc
    pavetwin plan export missions/monday/baseline --format wpml --drone mavic3e --highest 50 --from-buildings 5
    pavetwin plan export missions/monday/baseline --format litchi --format csv --no-fly zones.geojson -o plans
    pavetwin plan export worlds/berlin --segment Sonnenallee --altitude 15 --format wpml -o sonnenallee

    Heights are above the take-off point. The pilot is responsible for the flight: check every plan before you fly it.
    """
    from pavetwin.flightplan import check_limits, save_plan
    from pavetwin.flightplan.formats.plan_files import check_folder, remark_on_parts
    from pavetwin.mission.folder import mission_file
    from pavetwin.world.folder import DESCRIPTION

    released_by, formats = plans.checked()
    if output is not None:
        check_folder(output)
    with progress("Planning") as show:
        if (folder / DESCRIPTION).is_file():
            plan, world = _of_selection(folder, selection, released_by, show)
            target = output or folder / "plan"
        else:
            _refuse_selection(context, folder)
            plan, world = _of_mission(folder, released_by)
            target = output or mission_file(folder).parent / "plan"
        check_limits(plan, world, plans.limits(), [each.most_waypoints for each in formats])
        files = save_plan(plan, target, formats)
    print_plan(plan)
    if parts := remark_on_parts(files):
        out.line(parts)
    out.line(f"Written: {', '.join(map(str, files))}.")


def _refuse_selection(context: typer.Context, mission: Path) -> None:
    """Raises:
    PaveTwinError: an option for worlds is given with a mission.
    """
    for field in fields(SelectionOptions):
        if was_given(context, field.name):
            raise PaveTwinError(f"`{field.name}` is for a world; the mission '{mission}' holds its own.")


def _of_mission(folder: Path, trigger: "Trigger") -> "tuple[FlightPlan, World]":
    """Raises:
    PaveTwinError: the mission cannot be read or has changed.
    """
    from pavetwin.flightplan import plan_of
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import check_unchanged, world_of

    former = MissionFolder(folder, other_policy=True)
    world = world_of(former.spec.world)
    check_unchanged(former.spec.with_policy("baseline"), world)  # the track needs no file of its policy
    return plan_of(former, world, trigger=trigger), world


def _of_selection(
    folder: Path, selection: SelectionOptions, trigger: "Trigger", show: "Callable[[float], None]"
) -> "tuple[FlightPlan, World]":
    from pavetwin.flightplan import plan_of_selection
    from pavetwin.mission.planning import base_point
    from pavetwin.world.store import load_world

    settings, world = selection.settings(), load_world(folder)
    plan = plan_of_selection(
        world,
        settings,
        segments=selection.names or (),
        order=selection.order or "near",
        base=base_point(selection.base, world),
        trigger=trigger,
        on_progress=show,
    )
    return plan, world


def print_plan(plan: "FlightPlan") -> None:
    """Print the flights of a plan, and the duties of the pilot."""
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
        "The ground is assumed to be level, and obstacles to be as mapped; wires and trees may be missing. The pilot "
        "is "
        "responsible: check the plan, the airspace and the permits, and keep the aircraft in sight."
    )
