"""Labelled images as a user asks for them, by `capture` in a process of its own with its workers."""

import shutil
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Kind, Line, Size
from benchmarks.process import Used, run

ALTITUDES_M = (6.0, 10.0, 15.0)
SEED = 1


def lines(world: Path, folder: Path, size: Size) -> Iterator[Line]:
    """A first frame, and a dataset, of a world whose high traffic is recorded by a first run.

    Args:
        folder: for the datasets.
    """
    _captured(world, folder, 1)
    first = _captured(world, folder, 1)
    note = f"`capture --images 1`, labels and files included; processor time {first.processor_s:.1f} s; one run"
    yield Line("from the command to the first frame", first.wall_s, Kind.SECONDS, 4.0, note=note)
    _captured(world, folder, size.images)
    many = _captured(world, folder, size.images)
    note = f"{', '.join(f'{each:g}' for each in ALTITUDES_M)} m; processor time {many.processor_s:.0f} s; one run"
    yield Line(f"{size.images} labelled images, traffic recorded", many.wall_s, Kind.SECONDS, 30.0, note=note)


def _captured(world: Path, folder: Path, count: int) -> Used:
    shutil.rmtree(folder / "images", ignore_errors=True)
    altitudes = [word for each in ALTITUDES_M for word in ("--altitude", f"{each:g}")]
    words = ["capture", "make", str(world), "-o", str(folder / "images"), "--images", str(count)]
    return run([*words, *altitudes, "--density", "high", "--seed", str(SEED)])
