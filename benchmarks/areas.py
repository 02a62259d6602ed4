"""`python -m benchmarks.areas WORLD... [--traffic high los-C]`: traffic of an area against that of the whole town.

Single segments are flown over in recordings of their town, and of the streets within distances of them: the same
segments, moments and seeds, other traffic. Printed are the differences of means, area less town, with 95 % intervals
over recordings, and the distributions side by side.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from scipy.stats import ks_2samp

from pavetwin.config import MissionSettings, load_settings
from pavetwin.experiments.statistics.bootstrap import intervals
from pavetwin.mission.environment import MissionEnvironment, prepare
from pavetwin.mission.fly import fly_over
from pavetwin.mission.replay import Replay
from pavetwin.seeds import Stream, child
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder
from pavetwin.world.model import World
from pavetwin.world.store import load_world

RECORDED_S: Final = 400.0
TAKE_OFFS_S: Final = (0.0, 120.0, 240.0)
FEW: Final = 4
"""Segments of a square that are flown over."""

TOWN: Final = 0.0
"""Stands for the distance of the whole town."""

METRICS: Final = {"o": 100.0, "hidden": 100.0, "waited": 1.0, "waits": 100.0, "coverage": 100.0}
"""What is compared, and its factor: mean visibility of the captures of a mission that never reacts, its captures below
the threshold, seconds that a hovering mission waits, hovering missions that wait, defects that a mission finds."""


HEADS: Final = (
    *("world", "traffic", "distance", "share of lanes", "o", "captures below 0.7", "waiting", "missions that wait"),
    *("coverage", "furthest distributions"),
)


@dataclass(frozen=True)
class Course:
    """A town to fly over."""

    world: World
    environment: MissionEnvironment
    settings: MissionSettings

    @classmethod
    def of(cls, folder: Path) -> "Course":
        world = load_world(folder)
        settings = load_settings(parking={"enabled": False}, policy={"max_wait_s": 120.0}, traffic_area_m=None)
        return cls(world, prepare(world, settings), settings)

    def squares(self, count: int) -> list[list[int]]:
        """The segments to fly over, as places in the world, of some squares drawn among all."""
        by_square: dict[tuple[str, ...], list[int]] = {}
        for at, segment in enumerate(self.world.segments):
            if self.environment.reachable(at):
                area = TrafficArea.around(self.world, [segment.id], 1.0, most_share=2.0)
                by_square.setdefault(area.edges if area else (), []).append(at)
        rng, known = child(0, Stream.EXPERIMENT, 7), list(by_square.values())
        return [sorted(rng.permutation(known[at])[:FEW]) for at in rng.permutation(len(known))[:count]]

    def missions(self, traffic: str, seed: int, square: Sequence[int], distance_m: float) -> Iterator[dict[str, float]]:
        """A row for each segment and moment."""
        world = self.world
        targets = [world.segments[at].id for at in square]
        area = TrafficArea.around(world, targets, distance_m, most_share=2.0) if distance_m else None
        recorder = Recorder(Inputs.of(world, traffic, seed, area=area))
        recording = recorder.until(RECORDED_S)
        settings = self.settings.model_copy(update={"traffic_area_m": distance_m or None})
        share = recording.origin.capacity.lanes_km / Inputs.of(world, traffic, seed).capacity.lanes_km
        for take_off_s in TAKE_OFFS_S:
            with Replay(world, recording, start_s=take_off_s, recorder=recorder) as replay:
                for at in square:
                    looks = fly_over(self.environment, replay, settings, [at], "baseline", seed=seed)
                    waits = fly_over(self.environment, replay, settings, [at], "hover", seed=seed)
                    seen = looks.captures["visibility"]
                    yield {
                        "segment": at,
                        "share": share,
                        "speed_ratio": recording.speed_ratio or np.nan,
                        "o": float(seen.mean()),
                        "hidden": float((seen < self.settings.visibility.threshold).mean()),
                        "waited": waits.rows[0].wait_s,
                        "waits": float(waits.rows[0].wait_s > 0),
                        "coverage": looks.rows[0].coverage,
                    }


def measure(folder: Path, traffic: str, distances_m: Sequence[float], squares: int, seeds: int) -> pl.DataFrame:
    """All missions over a town; prints what is done."""
    course, rows = Course.of(folder), []
    for number, square in enumerate(course.squares(squares)):
        for seed in range(1, seeds + 1):
            for distance_m in (TOWN, *distances_m):
                flown = course.missions(traffic, seed, square, distance_m)
                key = {"world": folder.name, "traffic": traffic, "distance_m": distance_m}
                rows += [{**key, "square": number, "seed": seed, **row} for row in flown]
            print(f"{folder.name} {traffic} square {number} seed {seed}: {len(rows)} missions", flush=True)
    return pl.DataFrame(rows)


def table(rows: pl.DataFrame) -> str:
    """Differences of means in Markdown, a line for each town, traffic and distance."""
    lines = [f"| {' | '.join(HEADS)} |", "|" + "---|" * len(HEADS)]
    blocks = ["world", "traffic", "distance_m", "square", "seed"]
    means = rows.group_by(blocks).agg(pl.col([*METRICS, "share"]).mean()).sort(blocks)
    for (world, traffic), here in means.group_by(["world", "traffic"], maintain_order=True):
        mine = rows.filter(pl.col("world") == world, pl.col("traffic") == traffic)
        town = here.filter(pl.col("distance_m") == TOWN)
        for (distance_m,), area in here.group_by(["distance_m"], maintain_order=True):
            if distance_m == TOWN:
                shown = [f"{scale * town[name].mean():.1f}" for name, scale in METRICS.items()]
                lines.append(f"| {' | '.join([str(world), str(traffic), 'town', '1.00', *shown])} | |")
                continue
            lines.append(_line(str(world), str(traffic), distance_m, town, area, mine))
    return "\n".join(lines)


def _line(
    world: str, traffic: str, distance_m: float, town: pl.DataFrame, area: pl.DataFrame, rows: pl.DataFrame
) -> str:
    shown, furthest = [], ""
    differences = np.array([scale * (area[name] - town[name]).to_numpy() for name, scale in METRICS.items()])
    low, high = intervals(differences, np.zeros(differences.shape[1], dtype=np.intp), 0)
    for difference, least, most in zip(differences, low, high, strict=True):
        shown.append(f"{difference.mean():+.1f} ({least:+.1f} to {most:+.1f})")
    apart = {
        name: ks_2samp(*(rows.filter(pl.col("distance_m") == each)[name].to_numpy() for each in (TOWN, distance_m)))
        for name in ("o", "waited", "coverage")
    }
    name = max(apart, key=lambda each: apart[each].statistic)
    furthest = f"{name}: {apart[name].statistic:.2f}"
    head = [world, traffic, f"{distance_m:g} m", f"{area['share'].mean():.2f}"]
    return f"| {' | '.join([*head, *shown, furthest])} |"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.areas", description="Areas of traffic against towns.")
    parser.add_argument("worlds", type=Path, nargs="+")
    parser.add_argument("--traffic", nargs="+", default=["high", "los-C"])
    parser.add_argument("--distances", type=float, nargs="+", default=[100.0, 200.0])
    parser.add_argument("--squares", type=int, default=3)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("-o", "--output", type=Path, help="Parquet file of all missions, extended by those of this run")
    options = parser.parse_args(arguments)
    parts = [] if options.output is None or not options.output.exists() else [pl.read_parquet(options.output)]
    for world in options.worlds:
        for traffic in options.traffic:
            parts.append(measure(world, traffic, options.distances, options.squares, options.seeds))
            if options.output is not None:
                pl.concat(parts).write_parquet(options.output)
    print(table(pl.concat(parts)))


if __name__ == "__main__":
    main()
