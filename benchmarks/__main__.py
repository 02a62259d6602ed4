"""`python -m benchmarks [--quick] [--only GROUP …] [--world PATH] [--json FILE] [--plot PICTURE]`."""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

from benchmarks import (
    commands,
    defects,
    detecting,
    frames,
    growing,
    images,
    learning,
    machine,
    missions,
    page,
    photographs,
    startup,
    streets,
    studies,
    surveys,
    worlds,
)
from benchmarks.measure import Line, Size
from benchmarks.table import as_json, notes, plot, table
from pavetwin.cli.console import fail, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.replay import FIRST_DURATION_S, Replay
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.model import World
from pavetwin.world.store import load_world

FULL = Size(segments=8, runs=9, recorded_s=FIRST_DURATION_S, crowd_s=worlds.RECORDED_S, streets_m=(1000.0, 3000.0))
QUICK = Size(
    segments=3, runs=3, recorded_s=600.0, crowd_s=60.0, photographs=100, study={"replicates": 2}, survey=4, images=6
)


class Setup:
    """What several groups measure on, made when the first of them needs it."""

    def __init__(self, given: Path | None, size: Size, folder: Path) -> None:
        """
        Args:
            given: the user's own world, instead of the generated town.
        """
        self._given, self._size, self.folder = given, size, folder
        self.cache = folder / "cache"
        if given is not None:
            load_world(given)  # checked before the first measurement

    @cached_property
    def _built(self) -> tuple[Path, Line | None]:
        if self._given is not None:
            # A copy: the user's own recordings are neither used nor replaced.
            copy = shutil.copytree(self._given, self.folder / "world", ignore=shutil.ignore_patterns("traffic"))
            return Path(copy), None
        return self.folder / "town", worlds.build(self.folder / "town")

    @property
    def town(self) -> Path:
        return self._built[0]

    @cached_property
    def city(self) -> Path:
        """A network with ten times the town's lanes; the user's own world where given."""
        if self._given is None:
            worlds.city(self.folder / "city")
        return self.folder / "city" if self._given is None else self.town

    @cached_property
    def larger(self) -> Path:
        """A network of random streets with more than twice the town's lanes; the user's own world where given."""
        if self._given is None:
            worlds.build(self.folder / "larger", "random", seed=0)
        return self.folder / "larger" if self._given is None else self.town

    @cached_property
    def world(self) -> World:
        return load_world(self.town)

    @cached_property
    def _recorded(self) -> tuple[Replay, Line]:
        return worlds.record_high(self.world, self._size.recorded_s)

    @cached_property
    def course(self) -> missions.Course:
        return missions.Course.over(self.world, self.replay, min(self._size.segments, len(self.world.segments)))

    @property
    def replay(self) -> Replay:
        return self._recorded[0]

    def world_lines(self) -> Iterator[Line]:
        if self._built[1] is not None:
            yield self._built[1]
            yield worlds.demo_line(self.folder / "demo")
        yield worlds.load_line(self.town)

    def recording_lines(self) -> Iterator[Line]:
        yield self._recorded[1]
        yield from worlds.record_crowd(self.folder / "random", self._size.crowd, self._size.crowd_s)


GROUPS = (
    *("starting", "streets", "world", "defects", "recording", "missions", "sensors", "commands", "survey", "study"),
    *("visibility", "frames", "images", "photographs", "detector", "training", "memory", "city", "page"),
)
"""Each can be measured alone."""


def measure(
    world_folder: Path | None, size: Size, folder: Path, begin: Callable[[str], None], only: Sequence[str] = GROUPS
) -> Iterator[Line]:
    """All lines of some groups, one after the other; `begin` is called with the name of the next group."""
    os.environ[CACHE_VARIABLE] = str(folder / "cache")
    setup = Setup(world_folder, size, folder)
    groups: dict[str, Callable[[], Iterable[Line]]] = {
        "starting": lambda: startup.lines(size.runs),
        "streets": lambda: streets.lines(size),
        "world": setup.world_lines,
        "defects": lambda: defects.lines(setup.world, size),
        "recording": setup.recording_lines,
        "missions": lambda: missions.lines(setup.course, size.runs),
        "sensors": lambda: [missions.sensor_line(setup.course, size.runs)],
        "commands": lambda: commands.lines(setup.town, setup.larger, setup.city, folder, size),
        "survey": lambda: surveys.lines(setup.larger, setup.cache, folder, size),
        "study": lambda: studies.lines(setup.town, folder, size.study),
        "visibility": lambda: [missions.look_line(setup.course, size.runs)],
        "frames": lambda: frames.lines(setup.world, setup.replay, size),
        "images": lambda: images.lines(setup.town, folder, size),
        "photographs": lambda: [photographs.line(folder, size)],
        "detector": lambda: detecting.lines(folder, size),
        "training": lambda: learning.lines(folder, size),
        "memory": lambda: [missions.memory_line(setup.town, len(setup.course.targets))],
        "page": lambda: page.lines(setup.town, folder, size),
        "city": lambda: [growing.line(setup.course, 2 * size.runs + 1, size.copies)],
    }
    for name in GROUPS:
        if name in only:
            begin(name)
            yield from groups[name]()


def main(arguments: list[str]) -> int:
    """Measure, print, and write the JSON file if one is requested; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="How fast PaveTwin is on this machine.")
    parser.add_argument("--quick", action="store_true", help="fewer runs and shorter recordings: some minutes")
    parser.add_argument("--only", nargs="+", choices=GROUPS, default=GROUPS, metavar="GROUP", help=", ".join(GROUPS))
    parser.add_argument("--world", type=Path, help="fly over this world instead of a generated town")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers here as well")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw the numbers relative to their targets")
    options = parser.parse_args(arguments)
    described = machine.describe()
    load, busy = machine.load()
    described["load before"] = load
    begun = time.perf_counter()
    lines: list[Line] = []
    try:
        with tempfile.TemporaryDirectory(prefix="pavetwin-bench-") as folder, progress("Measuring") as tell:
            only = [name for name in GROUPS if name in options.only]
            lines += measure(
                options.world,
                QUICK if options.quick else FULL,
                Path(folder),
                lambda group: tell(only.index(group) / len(only), f"Measuring {group}"),
                only,
            )
    except PaveTwinError as error:
        fail(str(error))
        return 2
    _print(lines, described, busy=busy, took_s=time.perf_counter() - begun)
    try:
        if options.json is not None:
            with writing(options.json) as temporary:
                temporary.write_text(json.dumps(as_json(described, lines), indent=1) + "\n", encoding="utf-8")
        if options.plot is not None:
            plot(lines, options.plot)
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
    out.print(f"{missed} of {sum(line.reached is not None for line in lines)} targets not reached.")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
