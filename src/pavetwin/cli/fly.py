"""`pavetwin fly`: fly missions and write their results."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli.arguments import CacheFolder, Hour, Los, Mix, OptionalWorldFolder, Plugins, paths_of, traffic_name
from pavetwin.cli.conditions import OPTIONS as CONDITIONS
from pavetwin.cli.conditions import Clouds, Date, Time, Wind, conditions_of
from pavetwin.cli.console import out, progress
from pavetwin.cli.parking import Parking, parking_of
from pavetwin.cli.published import note_difference
from pavetwin.cli.sensor_option import SensorModel, check_has_model, model_option
from pavetwin.errors import PaveTwinError, about, naming

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.folder import MissionFolder
    from pavetwin.mission.inputs import MissionInputs
    from pavetwin.mission.result import MissionResult
    from pavetwin.mission.spec import MissionSpec

POLICY, SEGMENTS = "hover", "8"

FRAMES, NO_FRAMES = ("hits", "all", "none"), "none"
"""Values of --save-frames."""

FIXED_BY_AGAIN = (
    *("los", "hour", "density", "mix", "altitude", "segments", "segment", "order", "seed", "preset", "sensor", "model"),
    *("set_", "traffic", "traffic_area", "routes", "take_off", "base", "aircraft", "airspace", "plugin", "parking"),
    *CONDITIONS,
)
"""Options whose values a mission.yaml holds."""


def fly(
    context: typer.Context,
    world: OptionalWorldFolder = None,
    los: Los = None,
    hour: Hour = None,
    density: Annotated[
        str | None,
        typer.Option(help="Traffic by density: low, medium, high, or numbers: v12-p40. Unless any is given, --los C."),
    ] = None,
    mix: Mix = None,
    altitude: Annotated[float | None, typer.Option(help="Metres above ground; 10 unless set otherwise.")] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            help="{policies}; all for every registered one; or your own, file.py:ClassName. "
            "May be repeated. hover unless given."
        ),
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(help="{sensors}, or your own, file.py:ClassName. recall unless set otherwise.")
    ] = None,
    model: SensorModel = None,
    aircraft: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.yaml",
            help="{aircraft}, or your own, as in --aircraft mine.yaml:survey. mavic3e unless set otherwise.",
        ),
    ] = None,
    segments: Annotated[str, typer.Option(metavar="N|all", help="How many segments to inspect.")] = SEGMENTS,
    segment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID|STREET",
            help='Inspect this segment, or all of this street, as in --segment "Bell Lane"; may be given several '
            "times. Replaces --segments.",
        ),
    ] = None,
    parking: Parking = None,
    date: Date = None,
    time: Time = None,
    clouds: Clouds = None,
    wind: Wind = None,
    order: Annotated[str, typer.Option(help="Order of the segments: random, or near for a short tour.")] = "random",
    seed: Annotated[int, typer.Option(help="Random seed of traffic, order and sensor; 0 is a seed too.")] = 0,
    preset: Annotated[str, typer.Option(help="default or paper.")] = "default",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated."),
    ] = None,
    traffic: Annotated[
        Path | None, typer.Option(metavar="FILE.parquet", help="A recording of this world. Replaces --los.")
    ] = None,
    routes: Annotated[
        list[Path] | None, typer.Option(metavar="FILE.rou.xml", help="Your own SUMO demand. Replaces --los.")
    ] = None,
    take_off: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="When in the traffic to take off. Unless given: at once in a density, which is warmed up; over "
            "--routes 300 s after the first departure, or with the last one where that is earlier.",
        ),
    ] = None,
    traffic_area: Annotated[
        str | None,
        typer.Option(
            metavar="METRES|all",
            help="Simulate only the streets within this distance of the segments, 100 or more, with the traffic that "
            "the town has there; all, as unless given: the whole town.",
        ),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON|x,y",
            help="Where to take off, in degrees or in metres of the world's frame. Unless given, beside the "
            "carriageway in the middle of the streets; preset paper: on it.",
        ),
    ] = None,
    airspace: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Other aircraft: aircraft, t_s, x_m, y_m, altitude_m.")
    ] = None,
    defect_seed: Annotated[
        int | None, typer.Option(help="Place the defects again under this seed, as those of the world were.")
    ] = None,
    again: Annotated[
        Path | None, typer.Option(metavar="MISSION", help="Fly the mission of a folder again; needs no other option.")
    ] = None,
    only_missed: Annotated[
        bool,
        typer.Option(
            "--only-missed",
            help="With --again: only the segments on which it missed a defect that is not behind a parked vehicle.",
        ),
    ] = False,
    plugin: Plugins = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results.")] = None,
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
    force: Annotated[bool, typer.Option("--force", help="Replace another mission in the folder.")] = False,
    no_map: Annotated[bool, typer.Option("--no-map", help="Draw no map.")] = False,
    animate: Annotated[bool, typer.Option("--animate", help="Also draw an animation, mission.gif.")] = False,
    save_frames: Annotated[
        str,
        typer.Option(
            metavar="hits|all|none",
            help="Also render labelled frames into frames/: of captures that confirmed a defect, or of all.",
        ),
    ] = NO_FRAMES,
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
    _refuse_pairs(
        context,
        (
            *((option, "traffic", "routes") for option in ("los", "hour", "density", "mix", "traffic_area")),
            ("segment", "segments"),
        ),
    )
    if save_frames not in FRAMES:
        raise PaveTwinError(f"--save-frames {save_frames}: one of {', '.join(FRAMES)}.")
    asked = traffic_name(density, los, hour, mix)
    if density is None and los is None and hour is None:
        asked = None  # a mix alone names no level, so the usual one or the nearest to it is flown
    if world is None and again is None and not settings:
        raise PaveTwinError("Name the folder of a world, or that of a mission by --again.")
    if only_missed and again is None:
        raise PaveTwinError("--only-missed is of a mission that was flown; name its folder by --again.")
    former = _former(context, again, other_policy=policy is not None)
    missed = former.missed_segments() if former is not None and only_missed else None
    chosen = (
        former.spec.settings
        if former is not None
        else _settings(
            preset,
            altitude,
            sensor,
            model,
            aircraft,
            set_,
            paths_of(plugin),
            conditions_of(date, time, clouds, wind),
            {} if parking is None else parking_of(parking),
            {} if traffic_area is None else {"traffic_area_m": area_of(traffic_area)},
        )
    )

    from pavetwin.cli import pictures, report
    from pavetwin.mission.folder import check_replaceable
    from pavetwin.mission.inputs import load_inputs, world_of
    from pavetwin.mission.planning import check_names, mission_folder, plan_missions, policies_named
    from pavetwin.mission.saving import check_mission_folder
    from pavetwin.traffic.flow import flow_of
    from pavetwin.world.store import load_world

    names = policies_named(policy or [POLICY if former is None else former.spec.policy.name])
    options = {"sensing.sensor:": ("`sensor`:", sensor), "conditions.wind_mps:": ("`wind`:", wind)}
    with naming({key: option for key, (option, given) in options.items() if given is not None}):
        if model is not None:
            check_has_model(chosen)
        check_names(chosen, names, seed)
    if settings:
        out.print(report.settings_text(chosen), markup=False)
        return
    loaded = load_world(world) if world is not None else world_of(former.spec.world)  # type: ignore[union-attr]
    if save_frames != NO_FRAMES or looks_at_images(chosen):
        from pavetwin.capture.mission_images import check_frames

        check_frames(chosen, loaded)
    with progress("Preparing the flight domain") as tell:
        environment = None
        if former is not None:
            specs = [former.planned(loaded, policy=name, defect_seed=defect_seed, targets=missed) for name in names]
        else:
            specs, environment = plan_missions(
                loaded,
                chosen,
                names,
                density=asked,
                mix=mix or "",
                routes=routes or (),
                recording=traffic,
                take_off_s=take_off,
                segments=segment or _count(segments),
                order=order,
                seed=seed,
                defect_seed=defect_seed,
                airspace=airspace,
                base=base,
            )
        usual = not segment and order == "random" and segments == SEGMENTS

        def checked_folder() -> Path:
            folder = output or (
                (former.folder_again if missed is None else former.folder_of_missed)
                if former is not None
                else mission_folder(specs[0], names, preset, usual_targets=usual, usual_base=base is None)
            )
            check_mission_folder(folder)
            check_replaceable(folder, specs, force=force)
            return folder

        if output is not None or not specs[0].traffic.or_nearest:  # else its name depends on what can be recorded
            checked_folder()
        told = report.telling_of_areas(tell, specs[0], loaded)
        inputs = load_inputs(specs[0], world=loaded, environment=environment, on_progress=told)
        inputs.replay.flies_once = len(specs) == 1
        specs = [inputs.flown(spec) for spec in specs]
    folder = checked_folder()
    if former is None:
        out.line(f"Preset {preset}.")
        note_difference([preset], [loaded])
    vehicles, pedestrians = inputs.replay.recording.agents_at(specs[0].traffic.take_off_s)
    if parked := len(inputs.environment.parked):
        places = len(loaded.parking)
        out.line(f"{parked} vehicle{'s' * (parked != 1)} parked in {places} place{'s' * (places != 1)}.")
    out.line(
        f"Take-off {specs[0].traffic.take_off_s:g} s after the traffic begins, with {vehicles} "
        f"vehicle{'s' * (vehicles != 1)} and {pedestrians} pedestrian{'s' * (pedestrians != 1)} on the streets."
    )
    if pace := report.pace_line(specs[0].settings):
        out.line(pace)
    if instead := report.instead_line(specs[0]):
        out.line(instead)
    if where := report.area_line(inputs.replay.area, loaded):
        out.line(where)
    flow = flow_of(inputs.replay.recording)
    out.line(f"Traffic {inputs.replay.recording.name}: {flow.sentence} {flow.removals_sentence}")
    maps = not no_map
    results = _fly_and_draw(specs, inputs, folder, former, maps=maps, animate=animate, save_frames=save_frames)
    looked = looks_at_images(specs[0].settings)
    pictures.tell_files(results, folder, maps=maps, animate=animate, frames=save_frames != NO_FRAMES, sheet=looked)
    if former is not None and former.is_contradicted_by(results[0]):
        raise typer.Exit(1)


def looks_at_images(settings: "MissionSettings") -> bool:
    """Whether the mission's sensor is the one that looks at rendered captures."""
    return settings.sensing.sensor == "detector"


def _former(context: typer.Context, again: Path | None, *, other_policy: bool) -> "MissionFolder | None":
    """The mission to fly again.

    Raises:
        PaveTwinError: it cannot be read, or an option was given whose value its mission.yaml holds.
    """
    if again is None:
        return None
    from pavetwin.mission.folder import MissionFolder

    for option in FIXED_BY_AGAIN:
        if _given(context, option):
            raise PaveTwinError(
                f"--again: the mission.yaml says --{option.rstrip('_').replace('_', '-')}; leave one of the two out."
            )
    with about("again"):
        if not again.exists():
            raise PaveTwinError(f"there is no '{again}'; name the folder of a mission, or its mission.yaml.")
        former = MissionFolder(again, other_policy=other_policy)
        former.spec  # noqa: B018 - refused here, where the option is named
        return former


def _fly_and_draw(
    specs: Sequence["MissionSpec"],
    inputs: "MissionInputs",
    folder: Path,
    former: "MissionFolder | None",
    *,
    maps: bool,
    animate: bool,
    save_frames: str,
) -> list["MissionResult"]:
    """Fly missions that differ in their policy, write each as soon as it is flown, print what came out, then draw."""
    from pavetwin.capture.mission_images import MissionImages
    from pavetwin.cli import pictures, report
    from pavetwin.cli.flight_progress import FlightProgress
    from pavetwin.mission.fly import fly as fly_mission
    from pavetwin.sensing import reused_sensor

    replay, environment, several = inputs.replay, inputs.environment, len(specs) > 1
    images = MissionImages(environment.inspected_world, replay, specs[0].seed, environment.parked)
    frames = pictures.taking_frames(images, every=save_frames == "all") if save_frames != NO_FRAMES else None
    sheet = pictures.drawing_sheet(images) if looks_at_images(specs[0].settings) else None

    def missions() -> Iterator["MissionResult"]:
        eyes = reused_sensor(specs[0].settings.sensing, specs[0].seed) if several else None
        for spec in specs:
            what = f"Flying {Path(spec.policy.name).name}"
            with progress(what) as tell:
                flight = FlightProgress(tell, what, replay)
                inputs.on_extend(flight.extended)
                look = partial(tell, what="Rendering the captures and searching them")
                yield fly_mission(
                    spec,
                    inputs=inputs,
                    sensor=eyes,
                    image_source=images,
                    observer=flight,
                    on_look=look,
                    watches_defects=True,
                )

    with replay:
        results = report.save(missions(), folder, several=several)
        report.tell(results, inputs, former)
        pictures.draw(
            results, folder, several=several, maps=maps, animated=lambda _: animate, frames=frames, sheet=sheet
        )
    return results


def _settings(
    preset: str,
    altitude: float | None,
    sensor: str | None,
    model: str | None,
    aircraft: str | None,
    overrides: Sequence[str] | None,
    plugins: Sequence[str],
    conditions: Mapping[str, Any],
    parking: Mapping[str, Any],
    area: Mapping[str, float | None],
) -> "MissionSettings":
    from pavetwin.config import load_settings
    from pavetwin.config.mission import check_altitude

    given: dict[str, Any] = {**area}
    if altitude is not None:
        check_altitude(altitude)
        given["altitude_m"] = altitude
    if sensor is not None:
        given["sensing"] = {"sensor": sensor}
    if model is not None:
        chosen = load_settings(preset, overrides or (), **given).sensing.sensor
        given.setdefault("sensing", {})["options"] = model_option(model, chosen)
    if aircraft is not None:
        given["aircraft"] = aircraft
    if plugins:
        given["plugins"] = plugins
    if conditions:
        given["conditions"] = conditions
    if parking:
        given["parking"] = parking
    return load_settings(preset, overrides or (), **given)


def area_of(text: str) -> float | None:
    """The setting `traffic_area_m` as --traffic-area gives it.

    Raises:
        PaveTwinError: it is neither a distance nor `all`.
    """
    from pavetwin.config.mission import LEAST_AREA_M

    if text == "all":
        return None
    try:
        distance_m = float(text)
    except ValueError:
        raise PaveTwinError(f"--traffic-area {text}: expected metres or 'all'.") from None
    if not LEAST_AREA_M <= distance_m < float("inf"):
        raise PaveTwinError(
            f"--traffic-area {text}: traffic needs {LEAST_AREA_M:g} m of streets to queue and to spread out; give "
            f"{LEAST_AREA_M:g} or more, or 'all'."
        )
    return distance_m


def _count(segments: str) -> int | None:
    if segments == "all":
        return None
    try:
        return int(segments)
    except ValueError:
        raise PaveTwinError(f"--segments {segments}: expected a number or 'all'.") from None


def _given(context: typer.Context, option: str) -> bool:
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"


def _refuse_pairs(context: typer.Context, groups: Sequence[Sequence[str]]) -> None:
    """Raises:
    PaveTwinError: two options were given of which one replaces the other.
    """
    for group in groups:
        both = [f"--{option.replace('_', '-')}" for option in group if _given(context, option)]
        if len(both) > 1:
            raise PaveTwinError(f"{' and '.join(both)} exclude each other; give one of them.")
