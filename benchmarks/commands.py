"""Short missions as a user types them, in processes of their own: processor time, which other work does not change."""

import os
import statistics
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

from benchmarks.measure import Kind, Line, Size
from benchmarks.process import Used, run
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.traffic.demand import Capacity
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.store import load_world, save_world

RUNS, SEED, SHORT_M = 3, 1, 45.0
AREA_M = 200.0
QUIET = "v1-p1"
"""Traffic of the mission whose map is drawn: a map does not depend on it, a recording of two hours does."""


def lines(world: Path, larger: Path, city: Path, folder: Path, size: Size) -> Iterator[Line]:
    """`fly` over a few segments, and the map of a mission over many.

    Args:
        world: whose high traffic is recorded.
        larger: another world, with more streets.
        city: a world with ten times the streets.
        folder: for what the commands write.
    """
    count, runs = len(load_world(world).segments), min(size.runs, RUNS)
    few = min(size.few, count)
    yield from _from_nothing(world, larger, city, folder, few)
    took_s = _median_s(["fly", str(world), "--segments", str(few), "--density", "high"], folder / "few", runs)
    note = "processor time of one process, map included"
    yield Line(f"pavetwin fly, segments: {few}, high traffic recorded", took_s, Kind.SECONDS, 4.0, note=note)
    mapped = world if size.mapped <= count else _short_segments(folder / "short")
    words = ["fly", str(mapped), "--segments", str(size.mapped), "--order", "near", "--density", QUIET]
    whole_s = _median_s(words, folder / "many", runs)
    numbers_s = _median_s([*words, "--no-map"], folder / "many", runs)
    note = f"processor time of `fly` with its map less that without; the whole command {whole_s:.1f} s"
    yield Line(f"the map of a mission, segments: {size.mapped}", whole_s - numbers_s, Kind.SECONDS, 2.0, note=note)


def _from_nothing(world: Path, larger: Path, city: Path, folder: Path, few: int) -> Iterator[Line]:
    """With an empty cache: in traffic of the whole town over the larger world as well, and of an area over the city."""
    for where, area, other in (("the whole town", "all", larger), (f"{AREA_M:g} m around", f"{AREA_M:g}", city)):
        lanes_km = [Capacity.of(load_world(each)).lanes_km for each in (world, other)]
        took = []
        for number, each in enumerate((world, other)):
            words = ["fly", str(each), "--segments", str(few), "--density", "high", "--traffic-area", area]
            with patch.dict(os.environ, {CACHE_VARIABLE: str(folder / f"empty-{number}-{area}")}):
                took.append(_flown(words, folder / "few"))
        note = f"processor time, SUMO's included; {took[0].wall_s:.1f} s on the wall; one run"
        what = f"pavetwin fly, segments: {few}, high traffic of {where}, nothing recorded"
        yield Line(what, took[0].processor_s, Kind.SECONDS, 25.0, note=note)
        note = f"{lanes_km[0]:.1f} and {lanes_km[1]:.1f} km of lanes; the larger one {took[1].processor_s:.1f} s"
        what = f"the same over {lanes_km[1] / lanes_km[0]:.1f} × the streets"
        yield Line(what, took[1].processor_s / took[0].processor_s, Kind.RATIO, 1.3, note=note)


def _short_segments(folder: Path) -> Path:
    """The generated town in more than a hundred segments."""
    town = build_world("town", BuildOptions(seed=SEED, segment_length_m=SHORT_M))
    save_world(add_defects(town, DefectOptions(population="paper", per_segment=10)), folder)
    return folder


def _median_s(words: list[str], output: Path, runs: int) -> float:
    """Processor time after a first run, which records the traffic."""
    return statistics.median([_flown(words, output).processor_s for _ in range(runs + 1)][1:])


def _flown(words: list[str], output: Path) -> Used:
    return run([*words, "--seed", str(SEED), "-o", str(output), "--force"])
