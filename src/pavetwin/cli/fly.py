"""`pavetwin fly`: fly missions and write what they leave."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import out, progress
from pavetwin.errors import PaveTwinError

if TYPE_CHECKING:
    from pavetwin.config import MissionSettings
    from pavetwin.mission.fly import Flown
    from pavetwin.mission.ground import Stage
    from pavetwin.mission.replay import Replay
    from pavetwin.world.model import Defect, World

ALL = "all"


def fly(
    world: Annotated[Path, typer.Argument(help="Folder of the world.")],
    density: Annotated[str, typer.Option(help="Traffic: low, medium or high.")] = "medium",
    altitude: Annotated[float | None, typer.Option(help="Metres above ground; 10 unless set otherwise.")] = None,
    policy: Annotated[
        str, typer.Option(help="baseline, hover, micro, skip; all for the four; or your own, file.py:ClassName.")
    ] = "hover",
    segments: Annotated[str, typer.Option(metavar="N|all", help="How many segments to inspect.")] = "8",
    segment: Annotated[
        list[str] | None, typer.Option(help="Inspect this segment; may be given several times. Replaces --segments.")
    ] = None,
    order: Annotated[str, typer.Option(help="random, or near for a short tour.")] = "random",
    seed: Annotated[int, typer.Option(help="Names the luck of traffic, order and sensor; 0 is a seed too.")] = 0,
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
    defect_seed: Annotated[int | None, typer.Option(help="Place the defects anew under this seed.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the results.")] = None,
    animate: Annotated[bool, typer.Option("--animate", help="Also draw an animation, mission.gif.")] = False,
    settings: Annotated[bool, typer.Option("--settings", help="Show all settings as they would be, and stop.")] = False,
) -> None:
    """Fly a UAV over a world's streets in recorded traffic, and measure what it sees.

    \b
    pavetwin fly worlds/town --density high --altitude 10 --policy hover --segments 8 --seed 1
    pavetwin fly worlds/town --policy all --preset paper --altitude 6
    pavetwin fly worlds/town --segment s0004 --policy my_policy.py:Careful --set policy.max_wait_s=60
    """
    from pavetwin.cli import report
    from pavetwin.config import load_settings
    from pavetwin.mission.airspace import load_airspace
    from pavetwin.mission.ground import prepare
    from pavetwin.mission.results import check_mission_folder
    from pavetwin.mission.targets import choose_targets
    from pavetwin.policies import load_policy, policy_names
    from pavetwin.sensing import load_sensor
    from pavetwin.uav import energy_curve, find_camera
    from pavetwin.world.store import load_world

    if altitude is not None and not 0 < altitude < math.inf:
        raise PaveTwinError(f"--altitude {altitude:g}: the UAV flies at a number of metres above 0.")
    given = {} if altitude is None else {"altitude_m": altitude}
    chosen = load_settings(preset, set_ or (), **given)
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
    loaded = load_world(world)
    with progress("Preparing the flight domain") as tell:
        stage = prepare(loaded, chosen, _defects(loaded, defect_seed))
        tell(1.0)
    targets = choose_targets(stage, count=_count(segments), names=segment or (), order=order, seed=seed)
    aircraft = load_airspace(airspace) if airspace is not None else ()
    replay = _replay(loaded, density, seed, traffic, routes or [])
    replay.aircraft = aircraft
    folder = output or world / "missions" / _folder_name(policy, replay, chosen, preset, seed)
    check_mission_folder(folder)
    missions = (_fly_one(stage, replay, chosen, targets, name, seed) for name in names)
    flown = report.save(missions, replay, folder, several=policy == ALL, animated=lambda _: animate)
    for remark in replay.recording.remarks:
        out.print(f"[yellow]Note:[/] {remark}")
    out.print(report.segments_table(flown[0]) if len(flown) == 1 else report.comparison_table(flown))
    out.print(report.sentence(flown), markup=False, soft_wrap=True)
    out.print(f"Results in {folder}/: {report.listing(flown, animate=animate)}", markup=False, soft_wrap=True)


def _fly_one(
    stage: "Stage", replay: "Replay", settings: "MissionSettings", targets: Sequence[int], policy: str, seed: int
) -> "Flown":
    from pavetwin.mission.fly import fly as fly_mission

    with progress(f"Flying {Path(policy).name}") as tell:
        replay.on_prolong = lambda share: tell(share, "Recording more traffic")
        return fly_mission(
            stage, replay, settings, targets, policy, seed=seed, traffic_name=_traffic_name(replay), on_progress=tell
        )


def _replay(world: "World", density: str, seed: int, file: Path | None, routes: list[Path]) -> "Replay":
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


def _folder_name(policy: str, replay: "Replay", settings: "MissionSettings", preset: str, seed: int) -> str:
    name = policy.rpartition(":")[2]
    return f"{name}-{_traffic_name(replay)}-{settings.altitude_m:g}m-{preset}-seed{seed}"
