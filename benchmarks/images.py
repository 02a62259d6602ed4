"""Labelled images as a user asks for them, by `capture` in a process of its own with its workers."""

import shutil
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Kind, Line, Size
from benchmarks.process import Used, run
from pavetwin.world.cache import cache_folder

ALTITUDES_M = (6.0, 10.0, 15.0)
SEED = 1


def lines(world: Path, folder: Path, size: Size) -> Iterator[Line]:
    """A first frame, and a dataset, of a world whose high traffic is recorded by a first run; each once with no tiles
    in the cache and once with those of the run before.

    Args:
        folder: for the datasets.
    """
    _captured(world, folder, 1)
    flown = ", ".join(f"{each:g}" for each in ALTITUDES_M)
    for what, count, target_s, note in (
        ("from the command to the first frame", 1, 4.0, "`capture --images 1`, labels and files included"),
        (f"{size.images} labelled images, traffic recorded", size.images, 30.0, f"{flown} m"),
    ):
        shutil.rmtree(cache_folder("tiles"), ignore_errors=True)
        for which in (f"{what}, tiles made", "the same, tiles from the cache"):
            used = _captured(world, folder, count)
            told = f"{note}; processor time {used.processor_s:.1f} s, {used.peak_mib:,.0f} MiB; one run"
            yield Line(which, used.wall_s, Kind.SECONDS, target_s, note=told)


def _captured(world: Path, folder: Path, count: int) -> Used:
    shutil.rmtree(folder / "images", ignore_errors=True)
    altitudes = [word for each in ALTITUDES_M for word in ("--altitude", f"{each:g}")]
    words = ["capture", "make", str(world), "-o", str(folder / "images"), "--images", str(count)]
    return run([*words, *altitudes, "--density", "high", "--seed", str(SEED)])
