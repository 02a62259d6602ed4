"""Worlds and recordings to measure on, and how long it takes to make them."""

import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

from benchmarks.measure import Kind, Line
from benchmarks.process import run
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.mission.replay import Replay
from pavetwin.traffic.demand import Capacity, density_of
from pavetwin.traffic.record import record
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.generate import NetworkKind
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world

DEMO_TARGET_S = 6.0
RECORDED_S = 600.0
CITY = (
    "grid grid.x-number=12 grid.y-number=10 grid.x-length=130 grid.y-length=105 grid.attach-length=70 "
    "perturb-x=normc(0,7,-12,12) perturb-y=normc(0,7,-12,12)"
)
"""Options of netgenerate: those of a generated grid, with more streets."""
CITY_DEFECTS = 2.0
"""On each segment: more would make it long to build, and are not what is measured."""
SEED = 1


def build(
    folder: Path,
    source: Path | str = "town",
    defects_per_segment: float = 30.0,
    seed: int = SEED,
) -> Line:
    """The generated town, or the world of a file, into a folder."""
    begun = time.perf_counter()
    defects = DefectOptions(population="paper", per_segment=defects_per_segment)
    world = save_world(add_defects(build_world(source, BuildOptions(seed=seed)), defects), folder)
    took_s = time.perf_counter() - begun
    length_km = sum(segment.length_m for segment in world.segments) / 1000
    note = f"{len(world.segments)} segments, {length_km:.1f} km of streets, {len(world.defects)} defects; one run"
    what = f"building a world ({'the generated town' if source == 'town' else source})"
    return Line(what, took_s, Kind.SECONDS, note=note)


def city(folder: Path) -> None:
    """A grid of streets with ten times the lanes of the demo's town, and few defects."""
    with patch.dict("pavetwin.world.generate._SHAPES", {NetworkKind.GRID: CITY}):
        made = build_world("grid", BuildOptions(seed=0))
    save_world(add_defects(made, DefectOptions(population="paper", per_segment=CITY_DEFECTS)), folder)


def demo_line(folder: Path) -> Line:
    """The demo's town as its command builds it, with the damage that is usual there."""
    used = run(["world", "build", "--generate", "town", "--seed", str(SEED), "-o", str(folder), "--force"])
    note = f"the whole command; processor time of all cores {used.processor_s:.1f} s; one run"
    return Line("building the demo's town", used.wall_s, Kind.SECONDS, DEMO_TARGET_S, note=note)


def load_line(folder: Path) -> Line:
    """Opening a world that was built before."""
    begun = time.perf_counter()
    load_world(folder)
    return Line("opening it again", time.perf_counter() - begun, Kind.SECONDS, note="one run")


def record_high(world: World, duration_s: float) -> tuple[Replay, Line]:
    """High traffic over a world, recorded by SUMO; and what that took."""
    begun = time.perf_counter()
    recording = record(world, "high", SEED, duration_s, force=True)
    took_s = time.perf_counter() - begun
    walking = int(recording.agents.is_pedestrian.sum())
    note = f"{len(recording.agents) - walking} vehicles, {walking} pedestrians in all"
    line = Line(
        f"recording {duration_s / 60:.0f} min of high traffic",
        duration_s / took_s,
        Kind.REAL_TIME,
        took_s=took_s,
        note=note,
    )
    return Replay(world, recording), line


def record_crowd(folder: Path, agents: int, duration_s: float) -> Iterator[Line]:
    """As many vehicles and as many pedestrians at any time, over a network of random streets that has room for them."""
    world = save_world(build_world("random", BuildOptions(seed=SEED)), folder)
    capacity = Capacity.of(world)
    density = density_of(agents / capacity.lanes_km, agents / capacity.sidewalks_km)
    begun = time.perf_counter()
    record(world, density, SEED, duration_s)
    took_s = time.perf_counter() - begun
    yield Line(
        f"recording {duration_s / 60:.0f} min of {agents} vehicles and {agents} pedestrians",
        duration_s / took_s,
        Kind.REAL_TIME,
        RECORDED_S / 2.0,
        took_s=took_s,
        note="from nothing, with warm-up; the design expects 10 min in 2 s",
    )
