"""`pavetwin handover`: one folder for agency and pilot."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.cli.experiment import LimitOptions
from pavetwin.cli.options import grouped
from pavetwin.cli.plan import PlanOptions, print_plan
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.flightplan import PlanFormat, PlanLimits, Trigger
    from pavetwin.handover import Handover, StreetAdvice
    from pavetwin.mission.inputs import MissionInputs
    from pavetwin.mission.spec import MissionSpec
    from pavetwin.sensing import ImageSource

DESIGN = "design.yaml"
"""In the folder of a study."""


@grouped
def handover(
    folder: Annotated[Path, typer.Argument(metavar="MISSION|STUDY", help="Folder of a mission or of a study.")],
    chosen: LimitOptions,
    plans: PlanOptions,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the files; default: handover in that folder.")
    ] = None,
    study: Annotated[
        Path | None,
        typer.Option(
            metavar="STUDY", help="With a mission: a study over the same world, for recommendations by street."
        ),
    ] = None,
    world: Annotated[str | None, typer.Option(help="The world, for a study with several.")] = None,
    traffic: Annotated[str | None, typer.Option(help="The traffic, for a study with several.")] = None,
    sensor: Annotated[str | None, typer.Option(help="The sensor, for a study with several.")] = None,
    preset: Annotated[str | None, typer.Option(help="The preset, for a study with several.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing handover.")] = False,
) -> None:
    """Make one folder that an agency can file and a pilot can take along.

    For a study, its recommendation is flown once over all its streets.

    \b
    pavetwin handover missions/monday/hover
    pavetwin handover missions/monday/hover --format wpml --drone mavic3e --highest 50 -o for-the-agency
    pavetwin handover studies/first --traffic los-C --min-coverage 20
    pavetwin handover missions/monday/hover --study studies/first --traffic los-C

    It holds a page (handover.pdf and handover.html), a map, a plan for each set of batteries, the defects found and
    missed, and the condition index of sample units and streets (CSV, handover.gpkg for QGIS, handover.xlsx).
    """
    from pavetwin.handover import advice_of, check_target
    from pavetwin.mission.folder import mission_file
    from pavetwin.mission.saving import MISSION

    released_by, formats = plans.checked()
    objective, within = chosen.chosen_objective(), chosen.limits()
    levels = {"world": world, "traffic": traffic, "sensor": sensor, "preset": preset}
    is_study = (folder / DESIGN).is_file()
    source = _source(folder, study, levels, is_study=is_study)
    if not is_study and not mission_file(folder).is_file():
        raise PaveTwinError(f"'{folder}' is neither the folder of a mission ({MISSION}) nor of a study ({DESIGN}).")
    target = output or (folder if is_study else mission_file(folder).parent) / "handover"
    check_target(target, force=force)
    advice = None if source is None else advice_of(source, levels, within, objective)
    limits = plans.limits()
    if is_study:
        assert advice is not None
        _of_study(folder, advice, target, released_by, formats, limits, force=force)
    else:
        _of_mission(mission_file(folder), advice, target, released_by, formats, limits, force=force)


def _source(folder: Path, study: Path | None, levels: Mapping[str, str | None], *, is_study: bool) -> Path | None:
    """The study for recommendations; None without one.

    Raises:
        PaveTwinError: the study does not exist, there are two, or an option needs a study.
    """
    if study is not None and is_study:
        raise PaveTwinError(f"`study` {study}: '{folder}' is a study itself; name a mission.")
    if study is not None and not (study / DESIGN).is_file():
        raise PaveTwinError(f"`study` {study}: this folder holds no study.")
    for name, level in levels.items():
        if level is not None and not is_study and study is None:
            raise PaveTwinError(f"`{name}` {level}: it is for a study; name one, or add `study`.")
    return folder if is_study else study


def _of_mission(
    file: Path,
    advice: "StreetAdvice | None",
    target: Path,
    trigger: "Trigger",
    formats: "list[PlanFormat]",
    limits: "PlanLimits",
    *,
    force: bool,
) -> None:
    from pavetwin.flightplan import check_limits
    from pavetwin.handover import handover_of, write_handover
    from pavetwin.mission.folder import MissionFolder

    with progress("Reading") as tell:
        given = handover_of(MissionFolder(file), trigger=trigger, advice=advice)
        check_limits(given.plan, given.world, limits, [each.most_waypoints for each in formats])
        tell(0.4, "Writing")
        plans = write_handover(given, target, formats, force=force)
    _print_handover(given, target, plans)


def _of_study(
    folder: Path,
    advice: "StreetAdvice",
    target: Path,
    trigger: "Trigger",
    formats: "list[PlanFormat]",
    limits: "PlanLimits",
    *,
    force: bool,
) -> None:
    from pavetwin.files import staging_folder
    from pavetwin.flightplan import check_limits
    from pavetwin.handover import fly_recommended, handover_of, write_handover
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.saving import save_mission

    out.line(advice.overall.sentences[0])
    with staging_folder(target.with_name(f"{target.name}-mission")) as staging, progress("Flying") as tell:
        flown = staging / "mission"
        save_mission(fly_recommended(folder, advice, _images, tell), flown)
        given = handover_of(MissionFolder(flown), name=advice.study, trigger=trigger, advice=advice)
        check_limits(given.plan, given.world, limits, [each.most_waypoints for each in formats])
        tell(0.9, "Writing")
        plans = write_handover(given, target, formats, force=force, with_mission=True)
    _print_handover(given, target, plans)
    out.line(f"The mission is in {target / 'mission'}.")


def _images(inputs: "MissionInputs", spec: "MissionSpec") -> "ImageSource":
    from pavetwin.capture.mission_images import MissionImages

    environment = inputs.environment
    return MissionImages(environment.inspected_world, inputs.replay, spec.seed, environment.parked)


def _print_handover(given: "Handover", target: Path, plans: list[str]) -> None:
    from pavetwin.flightplan.formats.plan_files import remark_on_parts
    from pavetwin.handover import HANDOVER_FILES
    from pavetwin.handover.files import INVENTORY

    found, defects = given.found, given.defects.height
    out.line(
        f"{found} of {defects} defects found; PCI of the found defects {given.pci_found:.1f}, true PCI "
        f"{given.condition.pci:.1f}, over {len(given.condition.true)} sample units of {given.streets.height} streets."
    )
    print_plan(given.plan)
    if parts := remark_on_parts([target / name for name in plans]):
        out.line(parts)
    listed = ["inventory/"] if (target / INVENTORY).is_dir() else []
    out.line(f"Results in {target}: {', '.join([*HANDOVER_FILES, *listed, *(f'plan/{name}' for name in plans)])}.")
    note_fonts(given.world)
