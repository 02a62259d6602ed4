"""`pavetwin fly`: fly missions and write their results."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.cli.options import (
    AircraftOptions,
    CacheFolder,
    ConditionOptions,
    SensorOptions,
    SettingsOptions,
    TargetOptions,
    TrafficOptions,
    existing_world,
    grouped,
    naming_options,
    refuse_together,
    was_given,
)
from pavetwin.cli.published import note_difference
from pavetwin.errors import PaveTwinError, about

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import MissionInputs
    from pavetwin.mission.result import MissionResult
    from pavetwin.mission.spec import MissionSpec
    from pavetwin.world.model import World

POLICY = "hover"

FRAMES, NO_FRAMES = ("hits", "all", "none"), "none"
"""Values of --save-frames."""

IN_MISSION_FILE = (TrafficOptions, TargetOptions, AircraftOptions, SensorOptions, ConditionOptions, SettingsOptions)
"""Groups whose values a mission.yaml holds."""


@dataclass(frozen=True)
class AgainOptions:
    """Flying again."""

    again: Annotated[
        Path | None, typer.Option(metavar="MISSION", help="Fly the mission of a folder again; needs no other option.")
    ] = None
    only_missed: Annotated[
        bool,
        typer.Option(
            "--only-missed",
            help="With --again: only the segments with missed defects, without those behind parked vehicles.",
        ),
    ] = False
    defect_seed: Annotated[
        int | None, typer.Option(help="Place the defects again under this seed, by the rules of the world.")
    ] = None

    def former(self, context: typer.Context, *, other_policy: bool) -> "MissionFolder | None":
        """The mission to fly again.

        Raises:
            PaveTwinError: it cannot be read, or an option was given whose value its mission.yaml holds.
        """
        if self.again is None:
            if self.only_missed:
                raise PaveTwinError("`only_missed` applies to a flown mission; give its folder with `again`.")
            return None
        from pavetwin.mission.folder import MissionFolder

        for name in (field.name for group in IN_MISSION_FILE for field in fields(group)):
            if was_given(context, name):
                raise PaveTwinError(f"`again`: the mission.yaml holds `{name}`; omit one of the two.")
        with about("again"):
            if not self.again.exists():
                raise PaveTwinError(f"there is no '{self.again}'; name the folder of a mission, or its mission.yaml.")
            former = MissionFolder(self.again, other_policy=other_policy)
            former.spec  # noqa: B018 - refused here, where the option is named
            return former

    def planned(self, former: "MissionFolder", world: "World", policies: Sequence[str]) -> list["MissionSpec"]:
        """The missions to fly, one for each policy.

        Raises:
            PaveTwinError: with --only-missed, nothing was missed.
        """
        targets = former.missed_segments() if self.only_missed else None
        return [former.planned(world, policy=name, defect_seed=self.defect_seed, targets=targets) for name in policies]


@dataclass(frozen=True)
class ResultOptions:
    """Results."""

    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results.")] = None
    force: Annotated[bool, typer.Option("--force", help="Replace another mission in the folder.")] = False
    no_map: Annotated[bool, typer.Option("--no-map", help="Draw no map.")] = False
    animate: Annotated[bool, typer.Option("--animate", help="Also draw an animation, mission.gif.")] = False
    save_frames: Annotated[
        str,
        typer.Option(
            metavar="hits|all|none",
            help="Also render labelled images into frames/: of captures that confirmed a defect, or of all.",
        ),
    ] = NO_FRAMES

    @property
    def saves_frames(self) -> bool:
        return self.save_frames != NO_FRAMES

    def check(self) -> None:
        """Raises:
        PaveTwinError: a value is not known.
        """
        if self.save_frames not in FRAMES:
            raise PaveTwinError(f"`save_frames` {self.save_frames}: expected one of {', '.join(FRAMES)}.")


@grouped
def fly(
    context: typer.Context,
    traffic: TrafficOptions,
    targets: TargetOptions,
    aircraft: AircraftOptions,
    sensor: SensorOptions,
    conditions: ConditionOptions,
    chosen: SettingsOptions,
    repeat: AgainOptions,
    results: ResultOptions,
    world: Annotated[
        Path | None, typer.Argument(help="Folder of the world; may be omitted with --again.", callback=existing_world)
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            help="{policies}; all for every registered one; or your own, file.py:ClassName. May be repeated. "
            "Default: hover."
        ),
    ] = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    settings: Annotated[bool, typer.Option("--settings", help="Print the settings of this call and exit.")] = False,
) -> None:
    """Fly a UAV over a world's streets in recorded traffic, and measure what it sees.

    \b
    pavetwin fly worlds/town --altitude 10 --policy hover --segments 8 --seed 1
    pavetwin fly worlds/town --los E --mix south_asia --policy hover --policy skip
    pavetwin fly worlds/published --policy all --preset paper --density medium --altitude 6
    pavetwin fly worlds/town --aircraft phantom4pro --wind 6@270
    pavetwin fly worlds/town --date 2026-06-21 --time 09:30 --clouds 0.4 --wind 5@270 --save-frames hits
    pavetwin fly worlds/town --sensor detector --segments 1 --save-frames hits
    pavetwin fly worlds/town --sensor calibrated --model sensor.json
    pavetwin fly worlds/town --routes rush.rou.xml --take-off 600
    pavetwin fly worlds/town --parking 0.9
    pavetwin fly worlds/city --segments 3 --traffic-area 200
    pavetwin fly worlds/town --segment s0004 --policy my_policy.py:Careful --set policy.max_wait_s=60
    pavetwin fly --again worlds/town/missions/hover-high-1-10m-default-seed1/mission.yaml
    pavetwin fly --again worlds/town/missions/hover-high-1-10m-default-seed1/mission.yaml --only-missed
    """
    traffic.check(context)
    refuse_together(context, "names", "count")
    results.check()
    if world is None and repeat.again is None and not settings:
        raise PaveTwinError("Give the folder of a world, or that of a mission with `again`.")
    former = repeat.former(context, other_policy=policy is not None)
    if former is not None:
        mission_settings = former.spec.settings
    else:
        given = (traffic.settings(), aircraft.settings(), conditions.settings())
        mission_settings = chosen.load(*given, sensor=sensor)

    from pavetwin.cli import flight_report
    from pavetwin.mission.inputs import load_inputs, world_of
    from pavetwin.mission.planning import check_names, plan_missions, policies_named
    from pavetwin.world.store import load_world

    names = policies_named(policy or [POLICY if former is None else former.spec.policy.name])
    with naming_options(sensor=sensor.sensor, wind=conditions.wind):
        sensor.check(mission_settings)
        check_names(mission_settings, names, chosen.seed)
    if settings:
        out.print(flight_report.settings_text(mission_settings), markup=False)
        return
    loaded = load_world(world) if world is not None else world_of(former.spec.world)  # type: ignore[union-attr]
    if results.saves_frames or looks_at_images(mission_settings):
        from pavetwin.capture.mission_images import check_frames

        check_frames(mission_settings, loaded)
    with progress("Preparing the flight domain") as show:
        environment = None
        if former is not None:
            specs = repeat.planned(former, loaded, names)
        else:
            specs, environment = plan_missions(
                loaded,
                mission_settings,
                names,
                **traffic.planning(),
                **targets.planning(),
                airspace=aircraft.airspace,
                seed=chosen.seed,
                defect_seed=repeat.defect_seed,
            )
        folder_of = partial(_folder, results, repeat, targets, former, chosen.preset, names)
        if results.output is not None or not specs[0].traffic.or_nearest:  # else its name depends on the recording
            folder_of(specs)
        report = flight_report.reporting_whole_towns(show, specs[0], loaded)
        inputs = load_inputs(specs[0], world=loaded, environment=environment, on_progress=report)
        inputs.replay.flies_once = len(specs) == 1
        specs = [inputs.flown(spec) for spec in specs]
    folder = folder_of(specs)
    if former is None:
        out.line(f"Preset {chosen.preset}.")
        note_difference([chosen.preset], [loaded])
    flight_report.print_start(specs[0], inputs, loaded)
    flown = _fly_and_draw(specs, inputs, folder, former, results)
    flight_report.print_files(
        flown,
        folder,
        maps=not results.no_map,
        animate=results.animate,
        frames=results.saves_frames,
        sheet=looks_at_images(mission_settings),
    )
    if former is not None and former.is_contradicted_by(flown[0]):
        raise typer.Exit(1)


def looks_at_images(settings: "MissionSettings") -> bool:
    """Whether the mission's sensor searches rendered captures."""
    return settings.sensing.sensor == "detector"


def _folder(
    results: ResultOptions,
    repeat: AgainOptions,
    targets: TargetOptions,
    former: "MissionFolder | None",
    preset: str,
    policies: Sequence[str],
    specs: Sequence["MissionSpec"],
) -> Path:
    """The folder of the results.

    Raises:
        PaveTwinError: it cannot be written, or holds another mission.
    """
    from pavetwin.mission.folder import check_replaceable
    from pavetwin.mission.planning import mission_folder
    from pavetwin.mission.saving import check_mission_folder

    if results.output is not None:
        folder = results.output
    elif former is not None:
        folder = former.folder_of_missed if repeat.only_missed else former.folder_again
    else:
        folder = mission_folder(
            specs[0], policies, preset, usual_targets=targets.is_usual, usual_base=targets.base is None
        )
    check_mission_folder(folder)
    check_replaceable(folder, specs, force=results.force)
    return folder


def _fly_and_draw(
    specs: Sequence["MissionSpec"],
    inputs: "MissionInputs",
    folder: Path,
    former: "MissionFolder | None",
    results: ResultOptions,
) -> list["MissionResult"]:
    """Fly missions that differ in their policy, write each as soon as it is flown, print the results, then draw."""
    from pavetwin.capture.mission_images import MissionImages
    from pavetwin.cli import flight_report
    from pavetwin.mission.fly import fly as fly_mission
    from pavetwin.sensing import reused_sensor

    replay, environment, several = inputs.replay, inputs.environment, len(specs) > 1
    images = MissionImages(environment.inspected_world, replay, specs[0].seed, environment.parked)
    frames = flight_report.saving_frames(images, every=results.save_frames == "all") if results.saves_frames else None
    sheet = flight_report.drawing_sheet(images) if looks_at_images(specs[0].settings) else None

    def missions() -> Iterator["MissionResult"]:
        shared = reused_sensor(specs[0].settings.sensing, specs[0].seed) if several else None
        for spec in specs:
            what = f"Flying {Path(spec.policy.name).name}"
            with progress(what) as show:
                flight = flight_report.FlightProgress(show, what, replay)
                inputs.on_extend(flight.extended)
                yield fly_mission(
                    spec,
                    inputs=inputs,
                    sensor=shared,
                    image_source=images,
                    observer=flight,
                    on_look=partial(show, what="Rendering the captures and searching them"),
                    watches_defects=True,
                )

    with replay:
        flown = flight_report.save(missions(), folder, several=several)
        flight_report.print_results(flown, inputs, former)
        flight_report.draw(
            flown,
            folder,
            several=several,
            maps=not results.no_map,
            animated=lambda _: results.animate,
            frames=frames,
            sheet=sheet,
        )
    return flown
