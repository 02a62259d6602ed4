"""`python -m benchmarks.waiting STUDY [--altitude 10]`: what the waits of a study correlate with.

Beside each hovering mission in high traffic: how many vehicles stand on the inspected segment, on average over the
first five minutes of its recording. And how unevenly a world's streets are filled.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import polars as pl
import shapely
import yaml
from scipy.stats import spearmanr

from pavetwin.experiments.store import query
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.world.model import World
from pavetwin.world.store import load_world

SECONDS, STEP = 300.0, 20
"""Of each recording; every so many of its frames is looked at."""

STANDS_MPS = 0.5


def on_segments(world: World, recording: Recording) -> npt.NDArray[np.float64]:
    """(2, segments) vehicles on each, and those of them that stand, on average."""
    frames = range(0, recording.frames, STEP)
    rows = np.concatenate([np.arange(*recording.step_offsets[frame : frame + 2]) for frame in frames])
    rows = rows[~recording.agents.is_pedestrian[recording.agent[rows]]]
    tree = shapely.STRtree([segment.polygon for segment in world.segments])
    agent, segment = tree.query(shapely.points(recording.x[rows], recording.y[rows]), predicate="intersects")
    stands = recording.speed_mps[rows][agent] < STANDS_MPS
    counts = [np.bincount(each, minlength=len(world.segments)) for each in (segment, segment[stands])]
    return np.array(counts) / len(frames)


def missions(study: Path, altitude_m: float) -> pl.DataFrame:
    """A row for each hovering mission in high traffic, with `standing`; prints how full each world's streets are."""
    sql = f"select * from segments where policy = 'hover' and traffic = 'high' and altitude_m = {altitude_m}"
    result, parts = query(study, sql), []
    described = yaml.safe_load((study / "design.yaml").read_text(encoding="utf-8"))
    for name, entry in zip(described["worlds"], described["design"]["worlds"], strict=True):
        world, mine = load_world(Path(entry["path"])), result.filter(pl.col("world") == name)
        row = {segment.id: number for number, segment in enumerate(world.segments)}
        counts = [on_segments(world, record(world, "high", seed, SECONDS)) for seed in mine["traffic_seed"]]
        standing = [count[1, row[target]] for count, target in zip(counts, mine["segment"], strict=True)]
        parts.append(mine.with_columns(standing=pl.Series(standing)))
        length_m = np.array([segment.length_m for segment in world.segments])
        filled = np.sum([count[0] for count in counts], axis=0)
        order = np.argsort(-filled / length_m)
        share = np.interp(0.2, np.cumsum(length_m[order]) / length_m.sum(), np.cumsum(filled[order]) / filled.sum())
        print(f"{name}: {100 * share:.0f} % of the vehicles are on the fullest fifth of the streets' length")
    return pl.concat(parts)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.waiting", description="What a study's waits go with.")
    parser.add_argument("study", type=Path)
    parser.add_argument("--altitude", type=float, default=10.0)
    options = parser.parse_args(arguments)
    table = missions(options.study, options.altitude)
    rank = spearmanr(table["wait_s"], table["standing"]).statistic
    print(f"rank correlation of waiting and vehicles standing on the segment: {rank:.2f}")
    for (name,), mine in table.group_by(["world"], maintain_order=True):
        many = mine.filter(pl.col("standing") >= 5)
        print(
            f"{name}: {len(many)} of {len(mine)} segments hold five standing vehicles or more; "
            f"{many['wait_s'].sum():.0f} of {mine['wait_s'].sum():.0f} s are waited there"
        )


if __name__ == "__main__":
    main()
