"""`python -m benchmarks.fundamental WORLD …`: the fundamental diagram of worlds, and the table of levels of service.

For each world traffic is recorded at each level of service, and tried at densities from nearly empty to nearly jammed.
Speed ratio and flow over density, of these recordings and of all trials, are drawn (`docs/images/fundamental.png`), and
a Markdown table is printed, as `docs/explanation/traffic.md` has it.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from pavetwin.cli.console import fail, out, progress
from pavetwin.draw import style
from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import DEFAULT_MIX, LevelOfService
from pavetwin.traffic.demand_search import DemandSearch, Trial
from pavetwin.traffic.flow import Flow, flow_of
from pavetwin.traffic.record import record
from pavetwin.world.model import World
from pavetwin.world.store import load_world

SEEDS = (1, 2)
RECORDED_S = 1200.0

SWEEP = (2.0, 5.0, 8.0, 12.0, 16.0, 20.0, 25.0, 30.0, 36.0, 43.0, 52.0, 64.0, 80.0, 100.0)
"""Vehicles per kilometre of lane."""

DENSEST = 105.0
"""Of the plot."""


@dataclass(frozen=True)
class Level:
    """What one level of service came to in one world."""

    level: LevelOfService
    target: float | None
    flows: Sequence[Flow]
    found_s: float
    why: str = ""
    """Why it is beyond the world."""


def levels(world: World, recorded_s: float) -> Iterator[Level]:
    for level in LevelOfService:
        begun = time.perf_counter()
        search = DemandSearch(world, DEFAULT_MIX)
        try:
            target = search.target(level)[1]
            search.of_level(level)
        except PaveTwinError as error:
            yield Level(level, None, (), time.perf_counter() - begun, str(error))
            continue
        found_s = time.perf_counter() - begun
        flows = [flow_of(record(world, f"los-{level}", seed, recorded_s)) for seed in SEEDS]
        yield Level(level, target, flows, found_s)


def rows(world: World, found: Sequence[Level]) -> Iterator[str]:
    """Of the Markdown table."""
    for each in found:
        if each.target is None:
            yield f"| {world.name} | {each.level} | beyond reach | | | | |"
            continue
        for seed, flow in zip(SEEDS, each.flows, strict=True):
            missed = round(100 * ((flow.ratio or 0.0) / each.target - 1)) + 0  # no −0
            yield (
                f"| {world.name} | {each.level} | {each.target:.2f} | {flow.ratio:.3f} ({missed:+d} %, "
                f"{flow.level}, seed {seed}) | {flow.speed_kmh:.0f} km/h | {flow.per_lane_km:.1f} | "
                f"{flow.removed_per_vehicle_hour:.3f} |"
            )


def draw(axes: tuple[Axes, Axes], world: World, found: Sequence[Level], trials: Sequence[Trial]) -> None:
    """Speed ratio, and flow, over density: of the trials, whose density is held, and of the recordings."""
    speed, flow = axes
    density = [trial.per_lane_km for trial in trials]
    speed.plot(density, [trial.ratio for trial in trials], "o", color=style.INK_FAINT, ms=3.5, label="trials")
    flow.plot(density, [trial.flow_per_lane_h for trial in trials], "o", color=style.INK_FAINT, ms=3.5)
    for each in found:
        if not each.flows:
            continue
        colour = plt.get_cmap("viridis")(list(LevelOfService).index(each.level) / 5.5)
        xs = [it.per_lane_km for it in each.flows]
        speed.plot(xs, [it.ratio for it in each.flows], "D", color=colour, ms=6, label=f"LOS {each.level}")
        flow.plot(xs, [it.flow_per_lane_h for it in each.flows], "D", color=colour, ms=6)
    for level in LevelOfService:
        if level.above > 0:
            speed.axhline(level.above, color=style.INK_SOFT, lw=0.4, ls=":")
        top = min(level.up_to, 0.9)
        speed.annotate(level, (0.965 * DENSEST, (level.above + top) / 2), fontsize=8, color=style.INK_SOFT, va="center")
    speed.set(title=world.name, ylim=(0, 0.9), xlim=(0, DENSEST))
    flow.set(xlabel="vehicles per kilometre of lane", xlim=(0, DENSEST), ylim=(0, None))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fundamental", description=__doc__)
    parser.add_argument("worlds", nargs="+", type=Path, help="folders of worlds")
    parser.add_argument("--output", type=Path, default=Path("docs/images/fundamental.png"))
    parser.add_argument("--duration", type=float, default=RECORDED_S, help="of each recording, in seconds")
    asked = parser.parse_args()
    try:
        worlds = [load_world(path) for path in asked.worlds]
    except PaveTwinError as error:
        fail(str(error))
        return 2
    figure, axes = plt.subplots(2, len(worlds), figsize=(3.4 * len(worlds), 5.2), sharex=True, squeeze=False)
    lines = ["| world | class | target | measured ratio | speed | vehicles/lane-km | removals/vehicle-h |"]
    lines.append("|---|---|---|---|---|---|---|")
    notes = []
    with progress("Recording") as tell:
        for at, world in enumerate(worlds):
            tell(at / len(worlds))
            found = list(levels(world, asked.duration))
            search = DemandSearch(world, DEFAULT_MIX)
            for density in SWEEP:
                search.trial(density)
            draw((axes[0][at], axes[1][at]), world, found, search.trials)
            lines += rows(world, found)
            notes += [each.why for each in found if each.why]
            taken = ", ".join(f"{each.level} {each.found_s:.0f} s" for each in found)
            notes.append(f"Finding the demand in {world.name}: {taken}.")
    axes[0][0].set_ylabel("speed over speed limits")
    axes[1][0].set_ylabel("vehicles per hour and lane")
    axes[0][-1].legend(fontsize=7, frameon=False, loc="upper right", bbox_to_anchor=(0.93, 1.0))
    figure.tight_layout()
    asked.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(asked.output, dpi=140)
    for line in (*lines, "", *notes):
        out.line(line)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
