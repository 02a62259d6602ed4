"""A long mission over a network of random streets, as a user types it, in a process of its own."""

from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import Kind, Line, Size
from benchmarks.process import Used, run
from pavetwin.world.store import load_world

SEED = 2
"""Traffic that no other group records."""

SHORTER = 10
"""How many times as long the mission is as the one whose memory is compared with its."""


def lines(world: Path, cache: Path, folder: Path, size: Size) -> Iterator[Line]:
    """From nothing, then recorded; its memory beside that of a mission of a tenth of the segments; its file.

    Args:
        world: without recordings.
        cache: the cache of worlds, empty of recordings of this one.
        folder: for what the commands write.
    """
    count = min(size.survey, len(load_world(world).segments))
    known = {*cache.rglob("*.parquet")}
    first = _flown(world, folder, count)
    note = f"processor time, SUMO's included; {first.wall_s:.0f} s on the wall; one run"
    yield Line(
        f"a survey of {count} segments, high traffic, from nothing", first.processor_s, Kind.SECONDS, 75.0, note=note
    )
    (recorded,) = {*cache.rglob("*.parquet")} - known
    again = _flown(world, folder, count)
    note = f"processor time of one process, map included; {again.wall_s:.0f} s on the wall; one run"
    yield Line("the same, recorded", again.processor_s, Kind.SECONDS, 6.0, note=note)
    plain = _flown(world, folder, count, "--no-map")
    yield Line("the same without its map", plain.processor_s, Kind.SECONDS, note=f"peak {plain.peak_mib:,.0f} MiB")
    yield Line("its memory, at most", again.peak_mib, Kind.MEBIBYTES, 500.0, note="map included")
    shorter = _flown(world, folder, max(1, count // SHORTER), "--no-map")
    note = f"without maps: {plain.peak_mib:,.0f} and {shorter.peak_mib:,.0f} MiB"
    ratio = plain.peak_mib / shorter.peak_mib
    yield Line("the same to that of a tenth of the segments", ratio, Kind.RATIO, 1.1, note=note)
    size_mib = recorded.stat().st_size / 2**20
    yield Line("its recording on disk", size_mib, Kind.MEBIBYTES, 25e6 / 2**20)


def _flown(world: Path, folder: Path, count: int, *more: str) -> Used:
    words = ["fly", str(world), "--segments", str(count), "--density", "high", "--seed", str(SEED), "--force"]
    return run([*words, "-o", str(folder / "survey"), *more])
