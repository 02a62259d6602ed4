"""`pavetwin fly`: fly missions and write what they leave."""

import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pavetwin.cli.arguments import Plugins, WorldFolder, paths_of
from pavetwin.cli.conditions import OPTIONS, Clouds, Date, Time, Wind, check_daylight, conditions_of
from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.again import FormerMission
    from pavetwin.mission.environment import MissionEnvironment
    from pavetwin.mission.fly import MissionResult
    from pavetwin.mission.replay import Replay
    from pavetwin.traffic.demand import Density
    from pavetwin.world.model import Defect, World

ALL, SEGMENTS = "all", "8"

SAID_BY_AGAIN = ("density", "altitude", "segments", "segment", "order", "seed", "preset", "set_", *OPTIONS)
"""Options that a mission.yaml answers."""


def fly(
    context: typer.Context,
    world: WorldFolder,
    density: Annotated[str, typer.Option(help="Traffic: low, medium or high.")] = "medium",
    altitude: Annotated[float | None, typer.Option(help="Metres above ground; 10 unless set otherwise.")] = None,
    policy: Annotated[
        str, typer.Option(help="baseline, hover, micro, skip; all for the four; or your own, file.py:ClassName.")
    ] = "hover",
    segments: Annotated[str, typer.Option(metavar="N|all", help="How many segments to inspect.")] = SEGMENTS,
    segment: Annotated[
        list[str] | None, typer.Option(help="Inspect this segment; may be given several times. Replaces --segments.")
    ] = None,
    date: Date = None,
    time: Time = None,
    clouds: Clouds = None,
    wind: Wind = None,
    order: Annotated[str, typer.Option(help="random, or near for a short tour.")] = "random",
    seed: Annotated[int, typer.Option(help="Random seed of traffic, order and sensor; 0 is a seed too.")] = 0,
    preset: Annotated[str, typer.Option(help="default or paper.")] = "default",
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a setting; may be repeated."),
    ] = None,
    traffic: Annotated[
        Path | None, typer.Option(metavar="FILE.parquet", help="A recording of this world. Replaces --density.")
    ] = None,
    routes: Annotated[
        list[Path] | None, typer.Option(metavar="FILE.rou.xml", help="Your own SUMO demand. Replaces --density.")
    ] = None,
    airspace: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Other aircraft: aircraft, t_s, x_m, y_m, altitude_m.")
    ] = None,
    defect_seed: Annotated[int | None, typer.Option(help="Place the defects again with this seed.")] = None,
    again: Annotated[
        Path | None, typer.Option(metavar="mission.yaml", help="Fly that mission again; replaces what it says.")
    ] = None,
    plugin: Plugins = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results.")] = None,
    animate: Annotated[bool, typer.Option("--animate", help="Also draw an animation, mission.gif.")] = False,
    save_frames: Annotated[
        bool, typer.Option("--save-frames", help="Also take the frames of confirmed defects, labelled, into frames/.")
    ] = False,
    settings: Annotated[bool, typer.Option("--settings", help="Show all settings as they would be, and stop.")] = False,
) -> None:
    """Fly a UAV over a world's streets in recorded traffic, and measure what it sees.

    \b
    pavetwin fly worlds/town --density high --altitude 10 --policy hover --segments 8 --seed 1
    pavetwin fly worlds/town --policy all --preset paper --altitude 6
    pavetwin fly worlds/town --date 2026-06-21 --time 09:30 --clouds 0.4 --wind 5@270 --save-frames
    pavetwin fly worlds/town --segment s0004 --policy my_policy.py:Careful --set policy.max_wait_s=60
    pavetwin fly worlds/town --again worlds/town/missions/hover-high-1-10m-default-seed1/mission.yaml
    """
    from pavetwin.cli import report
    from pavetwin.config import load_settings
    from pavetwin.config.altitude import check_altitude
    from pavetwin.mission.again import read_mission
    from pavetwin.mission.airspace import load_airspace
    from pavetwin.mission.environment import prepare
    from pavetwin.mission.results import check_mission_folder
    from pavetwin.mission.targets import choose_targets
    from pavetwin.policies import load_policy, policy_names
    from pavetwin.sensing import load_sensor
    from pavetwin.uav import energy_curve, find_camera
    from pavetwin.world.store import load_world

    if altitude is not None:
        check_altitude(altitude)
    given: dict[str, Any] = {} if altitude is None else {"altitude_m": altitude}
    if plugin:
        given["plugins"] = paths_of(plugin)
    if conditions := conditions_of(date, time, clouds, wind):
        given["conditions"] = conditions
    chosen = load_settings(preset, set_ or (), **given)
    loaded, former, traffic_seed = None, None, seed
    wanted: Density | None = _density(density)
    if again is not None:
        _refuse_answered(context)
        loaded = load_world(world)
        former = read_mission(again, loaded)
        chosen, seed, segment = former.settings, former.seed, list(former.segments)
        wanted, traffic_seed = former.density, former.traffic_seed
        policy = policy if _given(context, "policy") else former.policy
        if wanted is None and not routes and traffic is None:
            raise PaveTwinError("--again: the mission was flown over your own routes; give them by --routes as well.")
        output = output or again.absolute().parent.with_name(f"{again.absolute().parent.name}-again")
    if settings:
        out.print(report.settings_text(chosen), markup=False)
        return
    names = policy_names() if policy == ALL else [policy]
    for name in names:
        load_policy(name, chosen.policy)
    load_sensor(chosen.sensing, seed)
    find_camera(chosen.camera.model)
    energy_curve(chosen.energy)
    if seed < 0:
        raise PaveTwinError(f"--seed {seed}: seeds are whole numbers from 0.")
    if save_frames:
        from pavetwin.render.adapter import find_adapter

        find_adapter()
    loaded = loaded or load_world(world)
    if save_frames:
        check_daylight(chosen, loaded)
    with progress("Preparing the flight domain") as tell:
        environment = prepare(loaded, chosen, _defects(loaded, defect_seed))
        tell(1.0)
    targets = choose_targets(environment, count=_count(segments), names=segment or (), order=order, seed=seed)
    aircraft = load_airspace(airspace) if airspace is not None else ()
    replay = _replay(loaded, wanted, traffic_seed, traffic, routes or [])
    replay.aircraft = aircraft
    folder = output or world / "missions" / _folder_name(
        policy,
        replay,
        chosen,
        preset,
        seed,
        others={
            "segments": targets if segment or order != "random" or segments != SEGMENTS else None,
            "defect_seed": defect_seed,
            "airspace": airspace and sha256(airspace.read_bytes()).hexdigest(),
        },
    )
    check_mission_folder(folder)
    with replay:
        missions = (_fly_one(environment, replay, chosen, targets, name, seed) for name in names)
        result = report.save(
            missions, replay, folder, several=policy == ALL, animated=lambda _: animate, frames=save_frames
        )
    for remark in replay.recording.remarks:
        out.print(f"[yellow]Note:[/] {remark}")
    out.print(report.segments_table(result[0]) if len(result) == 1 else report.comparison_table(result))
    out.print(report.sentence(result), markup=False, soft_wrap=True)
    for mission in result:
        if former is not None and mission.policy == former.policy:
            out.print(_compared(former, mission), soft_wrap=True)
    out.print(
        f"Results in {folder}/: {report.listing(result, animate=animate, frames=save_frames)}",
        markup=False,
        soft_wrap=True,
    )


def _fly_one(
    environment: "MissionEnvironment",
    replay: "Replay",
    settings: "MissionSettings",
    targets: Sequence[int],
    policy: str,
    seed: int,
) -> "MissionResult":
    from pavetwin.mission.fly import fly as fly_mission

    with progress(f"Flying {Path(policy).name}") as tell:
        replay.on_extend = lambda share: tell(share, "Recording more traffic")
        return fly_mission(
            environment,
            replay,
            settings,
            targets,
            policy,
            seed=seed,
            traffic_name=_traffic_name(replay),
            on_progress=tell,
        )


def _replay(world: "World", density: "Density | None", seed: int, file: Path | None, routes: list[Path]) -> "Replay":
    from pavetwin.mission.replay import Replay, replay_of
    from pavetwin.traffic.recording import load_recording

    if file is not None:
        return Replay(world, load_recording(file, world), routes)
    with progress("Recording traffic") as tell:
        return replay_of(world, None if routes else density, seed, routes=routes, on_progress=tell)


def _traffic_name(replay: "Replay") -> str:
    return f"{replay.recording.name}-{replay.recording.origin.seed}"


def _defects(world: "World", seed: int | None) -> "Sequence[Defect] | None":
    from pavetwin.defects import place

    return None if seed is None else place(world.segments, seed)


def _count(segments: str) -> int | None:
    if segments == ALL:
        return None
    try:
        return int(segments)
    except ValueError:
        raise PaveTwinError(f"--segments {segments}: expected a number or 'all'.") from None


def _density(name: str) -> "Density":
    from pavetwin.traffic.demand import density_named

    return density_named(name)


def _given(context: typer.Context, option: str) -> bool:
    source = context.get_parameter_source(option)
    return source is not None and source.name == "COMMANDLINE"


def _refuse_answered(context: typer.Context) -> None:
    """Raises:
    PaveTwinError: an option was given beside --again that the mission.yaml answers.
    """
    for option in SAID_BY_AGAIN:
        if _given(context, option):
            raise PaveTwinError(f"--again: the mission.yaml says --{option.rstrip('_')}; leave one of the two out.")


def _compared(former: "FormerMission", result: "MissionResult") -> str:
    """Whether a mission flown again came out as before: its mission.yaml does not hold every input."""
    from dataclasses import asdict

    from pavetwin.mission.results import detections_geojson, totals

    now = asdict(totals(result))
    other = [name for name, value in former.totals.items() if now.get(name) != value]
    if former.detections is not None and former.detections != detections_geojson(result):
        other.append("captures")
    if not other:
        return "The same as the first time."
    return (
        f"[yellow]Note:[/] not the same as the first time ({', '.join(other)}): give --defect-seed, --airspace, "
        "--routes and --policy as they were then."
    )


def _folder_name(
    policy: str, replay: "Replay", settings: "MissionSettings", preset: str, seed: int, others: dict[str, object]
) -> str:
    """Names a mission by what is asked for most, and by a short hash of `others` and settings that are not usual."""
    from pavetwin.config import load_settings

    unusual = {key: value for key, value in others.items() if value is not None}
    if settings != load_settings(preset, altitude_m=settings.altitude_m):
        unusual["settings"] = settings.model_dump(mode="json")
    if replay.recording.origin.asked is None:
        unusual["traffic"] = replay.recording.origin.inputs
    name = policy.rpartition(":")[2]
    plain = f"{name}-{_traffic_name(replay)}-{settings.altitude_m:g}m-{preset}-seed{seed}"
    mark = sha256(json.dumps(unusual, sort_keys=True).encode()).hexdigest()[:6]
    return f"{plain}-{mark}" if unusual else plain
