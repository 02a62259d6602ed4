"""`pavetwin demo`: the whole workflow on a generated town."""

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pavetwin.cli.console import err, out, progress
from pavetwin.cli.options import CacheFolder

if TYPE_CHECKING:
    from pavetwin.world.model import World

TOWN_SEED = 1
FLIGHT_SEED = 1
SEGMENTS = 8
ALTITUDE_M = 10.0
DENSITY = "high"
PER_100_M2 = 8.0
"""Defects of the worn town: London's councils filled as many potholes (see the damage population `survey`)."""


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the town and the results.")] = Path(
        "out/demo"
    ),
    cache: CacheFolder = None,  # noqa: ARG001 - its callback does it
) -> None:
    """Generate a worn town, record dense traffic in it, and fly the four policies over the same eight segments.

    \b
    pavetwin demo
    pavetwin demo -o /tmp/demo
    """
    from pavetwin.cli import flight_report
    from pavetwin.config import load_settings
    from pavetwin.config.mission import UavSettings
    from pavetwin.draw.world_map import save_world_map
    from pavetwin.mission.environment import prepare
    from pavetwin.mission.fly import fly
    from pavetwin.mission.inputs import MissionInputs
    from pavetwin.mission.planning import plan_mission
    from pavetwin.mission.replay import replay_of
    from pavetwin.mission.summary import missed_lines, sentence
    from pavetwin.navigation.take_off import with_roadside_base
    from pavetwin.policies import policy_names

    world = _town(output / "town")
    with progress("[1/4] Drawing the town"):
        save_world_map(with_roadside_base(world, UavSettings().radius_m), output / "town.png")
    with progress(f"[2/4] Recording {DENSITY} traffic with SUMO") as show:
        replay = replay_of(world, DENSITY, FLIGHT_SEED, on_progress=show)
    agents = replay.recording.agents
    walking = int(agents.is_pedestrian.sum())
    out.print(
        f"[2/4] Traffic: {len(agents) - walking} vehicles and {walking} pedestrians "
        f"in {replay.recording.duration_s / 60:.0f} min, {DENSITY} density."
    )
    with replay, progress("[3/4] Flying the four policies") as show:
        settings = load_settings(altitude_m=ALTITUDE_M)
        environment = prepare(world, settings, parking_seed=FLIGHT_SEED)
        spec = plan_mission(
            world, settings, density=DENSITY, segments=SEGMENTS, seed=FLIGHT_SEED, environment=environment
        )
        inputs = MissionInputs(environment, replay)
        inputs.on_extend(lambda share: show(share, "[3/4] Recording more traffic"))
        results = []
        for name in policy_names():
            results.append(fly(spec.with_policy(name), inputs=inputs))
            show(len(results) / len(policy_names()), "[3/4] Flying the four policies")
    minutes = sum(mission.duration_s for mission in results) / 60
    out.print(f"[3/4] Flown: {len(results)} missions over {SEGMENTS} segments at {ALTITUDE_M:g} m, {minutes:.0f} min.")
    folder = output / "missions"
    flight_report.save(results, folder, several=True)
    flight_report.draw(
        results, folder, several=True, animated=lambda mission: mission.policy == "hover", title="[4/4] Drawing"
    )
    out.print()
    out.print(flight_report.comparison_table(results))
    for line in (sentence(results), *missed_lines(results)):
        out.line(line)
    out.print(
        f"""
[bold]Results[/] in {folder}/
  comparison.png        the four policies over the same street
  hover/map.png         the whole mission; mission.gif shows it moving
  hover/mission.parquet one row per segment; with track.parquet and captures.geojson
  {output}/town.png     the town; town/world.gpkg opens in QGIS

[bold]Next:[/] your own town, from an OpenStreetMap extract
  pavetwin world build my-town.osm -o worlds/my-town
  pavetwin fly worlds/my-town --altitude 10 --policy all --segments 8 --seed 1{_activation()}""",
        soft_wrap=True,
    )


def _activation() -> str:
    """A hint for `make demo`, if the environment of the checkout is not on the shell's path."""
    activate = Path(sys.executable).with_name("activate")
    if shutil.which("pavetwin") or not activate.is_file():
        return ""
    return f"\n  (first activate the environment: source {activate})"


def _town(folder: Path) -> "World":
    from pavetwin.defects import DefectOptions
    from pavetwin.defects.placement import build_folder
    from pavetwin.errors import PaveTwinError
    from pavetwin.world.build import BuildOptions
    from pavetwin.world.generate import NetworkKind
    from pavetwin.world.store import load_record, load_world

    worn = DefectOptions(per_100_m2=PER_100_M2)
    try:
        same = folder.is_dir() and DefectOptions.of_record(load_record(folder)) == worn
        world = load_world(folder) if same else None
    except PaveTwinError as error:
        err.print(f"Building the town again: {error}", markup=False)
        world = None
    if world is None:
        with progress("[1/4] Generating a town") as show:
            streets = BuildOptions(seed=TOWN_SEED)
            world, _ = build_folder(NetworkKind.TOWN, folder, streets, worn, force=True, jobs=None, on_progress=show)
    length_km = sum(segment.length_m for segment in world.segments) / 1000
    out.print(
        f"[1/4] Town: {len(world.segments)} segments, {length_km:.1f} km of streets, {len(world.buildings)} buildings, "
        f"{len(world.defects)} defects."
    )
    return world
