"""`pavetwin handover`: what an agency files and a pilot takes along."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.cli.plan import Drone, FromBuildings, Highest, NoFly, PlanFormats, TriggerName, checked, tell_plan

if TYPE_CHECKING:
    from pavetwin.handover import Handover


def handover(
    folder: Annotated[Path, typer.Argument(metavar="MISSION", help="Folder of a mission, or its mission.yaml.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; handover in that one unless given.")
    ] = None,
    format_: PlanFormats = None,
    trigger: TriggerName = "distance",
    drone: Drone = None,
    highest: Highest = None,
    from_buildings: FromBuildings = 0.0,
    no_fly: NoFly = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a handover that is there.")] = False,
) -> None:
    """Make one folder that an agency can file and a pilot can take along.

    \b
    pavetwin handover missions/monday/hover
    pavetwin handover missions/monday/hover --format wpml --drone mavic3e --highest 50 -o for-the-agency

    It holds a page (handover.pdf and handover.html), a map, a plan for each set of batteries, the defects found and
    missed, and the condition index of sample units and streets (CSV, handover.gpkg for QGIS, handover.xlsx).
    """
    from pavetwin.flightplan import PlanLimits, check_limits
    from pavetwin.flightplan.save import remark_on_parts
    from pavetwin.handover import HANDOVER_FILES, check_target, handover_of, write_handover
    from pavetwin.mission.again import mission_file, read_mission

    released_by, formats = checked(trigger, drone, format_, no_fly)
    file = mission_file(folder)
    target = output or file.parent / "handover"
    check_target(target, force=force)
    with progress("Reading") as tell:
        given = handover_of(read_mission(file), trigger=released_by)
        check_limits(given.plan, given.world, PlanLimits(highest, from_buildings, no_fly))
        tell(0.4, "Writing")
        plans = write_handover(given, target, formats, force=force)
    _tell(given)
    if parts := remark_on_parts([target / name for name in plans]):
        out.line(parts)
    out.line(f"Results in {target}: {', '.join([*HANDOVER_FILES, *(f'plan/{name}' for name in plans)])}.")
    note_fonts(given.world)


def _tell(given: "Handover") -> None:
    found, defects = given.found, given.defects.height
    out.line(
        f"{found} of {defects} defects found; PCI of what was found {given.pci_found:.1f}, it is "
        f"{given.condition.pci:.1f}, over {len(given.condition.true)} sample units of {given.streets.height} streets."
    )
    tell_plan(given.plan)
