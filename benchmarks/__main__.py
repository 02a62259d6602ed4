"""`python -m benchmarks [--quick] [--world PATH] [--json FILE]`."""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

from benchmarks import (
    commands,
    defects,
    frames,
    growing,
    machine,
    missions,
    photographs,
    startup,
    streets,
    studies,
    worlds,
)
from benchmarks.measure import Line, Size
from benchmarks.table import as_json, notes, table
from pavetwin.cli.console import fail, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.replay import FIRST_DURATION_S
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.store import load_world

FULL = Size(segments=8, runs=9, recorded_s=FIRST_DURATION_S, crowd_s=worlds.RECORDED_S, streets_m=(1000.0, 3000.0))
QUICK = Size(segments=3, runs=3, recorded_s=600.0, crowd_s=60.0, photographs=100, study={"replicates": 2})


def measure(world_folder: Path | None, size: Size, folder: Path, begin: Callable[[str], None]) -> Iterator[Line]:
    """All lines, one after the other; `begin` is called with the next step."""
    os.environ[CACHE_VARIABLE] = str(folder / "cache")
    if world_folder is not None:
        load_world(world_folder)  # checked before the first measurement
        # A copy: the user's own recordings are neither used nor replaced.
        world_folder = Path(shutil.copytree(world_folder, folder / "world", ignore=shutil.ignore_patterns("traffic")))
    begin("starting")
    yield from startup.lines(size.runs)
    begin("NavMesh")
    yield from streets.lines(size)
    begin("world")
    if world_folder is None:
        world_folder = folder / "town"
        yield worlds.build(world_folder)
    world = load_world(world_folder)
    yield worlds.load_line(world_folder)
    begin("defects")
    yield from defects.lines(world, size)
    begin("recording")
    replay, line = worlds.record_high(world, size.recorded_s)
    yield line
    begin("missions")
    course = missions.Course.over(world, replay, min(size.segments, len(world.segments)))
    yield from missions.lines(course, size.runs)
    begin("commands")
    yield from commands.lines(world_folder, folder, size)
    begin("the paper's study")
    yield from studies.lines(world_folder, folder, size.study)
    begin("visibility")
    yield missions.look_line(course, size.runs)
    begin("frames")
    yield from frames.lines(world, replay, size)
    begin("photographs")
    yield photographs.line(folder, size)
    begin("memory")
    yield missions.memory_line(world_folder, len(course.targets))
    begin("city × 100")
    yield growing.line(course, 2 * size.runs + 1, size.copies)
    begin("a crowd")
    yield from worlds.record_crowd(folder / "random", size.crowd, size.crowd_s)


PARTS = 14


def main(arguments: list[str]) -> int:
    """Measure, print, and write the JSON file if one is requested; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="How fast PaveTwin is on this machine.")
    parser.add_argument("--quick", action="store_true", help="fewer runs and shorter recordings: within a minute")
    parser.add_argument("--world", type=Path, help="fly over this world instead of a generated town")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    options = parser.parse_args(arguments)
    described = machine.describe()
    load, busy = machine.load()
    described["load before"] = load
    begun = time.perf_counter()
    lines: list[Line] = []
    try:
        with tempfile.TemporaryDirectory(prefix="pavetwin-bench-") as folder, progress("Measuring") as tell:
            begun_parts = count()
            lines += measure(
                options.world,
                QUICK if options.quick else FULL,
                Path(folder),
                lambda part: tell(next(begun_parts) / PARTS, f"Measuring {part}"),
            )
    except PaveTwinError as error:
        fail(str(error))
        return 2
    _print(lines, described, busy=busy, took_s=time.perf_counter() - begun)
    if options.json is None:
        return 0
    try:
        with writing(options.json) as temporary:
            temporary.write_text(json.dumps(as_json(described, lines), indent=1) + "\n", encoding="utf-8")
    except PaveTwinError as error:
        fail(str(error))
        return 2
    return 0


def _print(lines: list[Line], described: dict[str, str], *, busy: bool, took_s: float) -> None:
    out.print(table(lines))
    for note in notes(lines):
        out.print(note, markup=False, style="dim")
    out.print()
    for name, text in described.items():
        out.print(f"{name}: {text}", markup=False)
    out.print(f"load after: {machine.load()[0]}; took {took_s:.0f} s", markup=False)
    if busy:
        out.print("[bold yellow]The machine was busy with something else: the times are longer than they need be.[/]")
    missed = sum(line.reached is False for line in lines)
    out.print(f"{missed} of {sum(line.target is not None for line in lines)} targets not reached.")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
