"""Whole commands as a user types them, in processes of their own: processor time, which other work does not change."""

import statistics
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Kind, Line, Size
from benchmarks.startup import processor_s
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.store import load_world, save_world

RUNS, SEED, SHORT_M = 3, 1, 45.0
QUIET = "v1-p1"
"""Traffic of the mission whose map is drawn: a map does not depend on it, a recording of two hours does."""


def lines(world: Path, folder: Path, size: Size) -> Iterator[Line]:
    """`fly` over a world whose high traffic is recorded, and the map of a mission over many segments.

    Args:
        folder: for what the commands write.
    """
    count, runs = len(load_world(world).segments), min(size.runs, RUNS)
    few = min(size.few, count)
    took_s = _median_s(["fly", str(world), "--segments", str(few), "--density", "high"], folder / "few", runs)
    note = "processor time of one process, map included"
    yield Line(f"pavetwin fly, segments: {few}, high traffic recorded", took_s, Kind.SECONDS, 4.0, note=note)
    mapped = world if size.mapped <= count else _short_segments(folder / "short")
    words = ["fly", str(mapped), "--segments", str(size.mapped), "--order", "near", "--density", QUIET]
    whole_s = _median_s(words, folder / "many", runs)
    numbers_s = _median_s([*words, "--no-map"], folder / "many", runs)
    note = f"processor time of `fly` with its map less that without; the whole command {whole_s:.1f} s"
    yield Line(f"the map of a mission, segments: {size.mapped}", whole_s - numbers_s, Kind.SECONDS, 2.0, note=note)


def _short_segments(folder: Path) -> Path:
    """The generated town in more than a hundred segments."""
    town = build_world("town", BuildOptions(seed=SEED, segment_length_m=SHORT_M))
    save_world(add_defects(town, DefectOptions(population="paper", per_segment=10)), folder)
    return folder


def _median_s(words: list[str], output: Path, runs: int) -> float:
    """After a first run, which records the traffic."""
    command = [*words, "--seed", str(SEED), "-o", str(output), "--force"]
    return statistics.median([processor_s(command) for _ in range(runs + 1)][1:])
