"""`python -m benchmarks.pairs OTHER WORLD`: frames and tiles of this checkout beside those of another one.

    git worktree add ../before COMMIT    # and build its kernel: make setup
    python -m benchmarks.pairs ../before WORLD
    python -m benchmarks.pairs . WORLD    # with itself: every interval should hold 1

A process of each checkout renders the same views of one saved world, which both must be able to open. They take turns
at each piece of work, so that other work on the machine meets both, and stay at a place until all its rounds are done,
so that no tile is made again. Prints the table of docs/reference/performance.md: medians, and the median ratio of the
pairs with its 95 % interval. Ratios are of user time. The system's time is a column of its own: handing out and
clearing pages took from 16 to 147 ms for one and the same tile, as the machine's free memory had it.
"""

import argparse
import json
import math
import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

from pavetwin.cli.console import progress

ROOT: Final = Path(__file__).resolve().parent.parent
PLACES: Final = 2
ROUNDS: Final = 12
EVERY: Final = 6
"""Of the streets, longest first, one of so many is a place."""
TILE_M, ALTITUDE_M, CAMERA_M = 32.0, 10.0, 1.3
SIZE_PX: Final = (640, 640)
MEASURE: Final = "--measure"
"""Of the process of one checkout: it answers each line of its input, an `Order`, by the `Cost` as a line."""
WARM, TIME = "warm", "time"


class Cost(NamedTuple):
    """Processor time, of all threads."""

    user_s: float
    system_s: float


Pairs = Mapping[str, Sequence[tuple[Cost, Cost]]]
"""By what was made: before and now, of each round at each place."""


def works(folder: Path, places: int) -> Iterator[Mapping[str, Callable[[], object]]]:
    """What is made at each place; by names that a checkout from before street looks has too."""
    from pavetwin.render.renderer import Renderer
    from pavetwin.scene.light import Light
    from pavetwin.scene.scene import Scene
    from pavetwin.scene.view import look, nadir
    from pavetwin.uav import find_camera
    from pavetwin.world.segments import direction_at, point_at
    from pavetwin.world.store import load_world

    world = load_world(folder)
    scene, camera, light = Scene(world, seed=1), find_camera("phantom4pro"), Light(40.0, 140.0)
    renderer, bare = Renderer(scene), Scene(world, seed=1, tiles_kept=0)

    def frame(view: Any, *, labels: bool) -> Callable[[], object]:
        return lambda: renderer.frame(view, light=light, camera=camera, instances=(), labels=labels, depth=labels)

    longest = sorted(world.segments, key=lambda each: -each.length_m)
    for segment in longest[: EVERY * places : EVERY]:
        at = 0.4 * segment.centre_line.length
        (x, y), (dx, dy) = point_at(segment.centre_line, at), direction_at(segment.centre_line, at)
        yaw, key = math.atan2(dy, dx), (int(x // TILE_M), int(y // TILE_M))
        above = nadir(camera, (x, y, ALTITUDE_M), yaw_rad=yaw, size_px=SIZE_PX)
        fov_rad = math.radians(50)
        along = look((x, y, CAMERA_M), yaw_rad=yaw, pitch_rad=-0.12, size_px=SIZE_PX, vertical_fov_rad=fov_rad)
        yield {
            f"a UAV's frame from {ALTITUDE_M:g} m": frame(above, labels=False),
            "the same with its labels": frame(above, labels=True),
            "a car's frame with its labels": frame(along, labels=True),
            "the maps of a ground tile": partial(bare.maps, key),
            "the meshes and objects of a tile": partial(bare.tile, key),
        }


def measure(folder: Path, places: int) -> None:
    """Answer orders: make everything of a place twice, so that its tiles are on the device, or time one work."""
    made = list(works(folder, places))
    print(json.dumps(list(made[0])), flush=True)
    for line in sys.stdin:
        order, place, what = json.loads(line)
        if order == WARM:
            for work in (*made[place].values(), *made[place].values()):
                work()
            print(json.dumps(None), flush=True)
        else:
            print(json.dumps(_cost(made[place][what])), flush=True)


def _cost(work: Callable[[], object]) -> Cost:
    before = resource.getrusage(resource.RUSAGE_SELF)
    work()
    after = resource.getrusage(resource.RUSAGE_SELF)
    return Cost(after.ru_utime - before.ru_utime, after.ru_stime - before.ru_stime)


class Checkout:
    """A process that measures with the package of one checkout."""

    def __init__(self, root: Path, world: Path, places: int) -> None:
        paths = os.pathsep.join([str(root.absolute() / "src"), str(ROOT)])
        self.process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.pairs", MEASURE, str(world.absolute()), str(places)],
            env={**os.environ, "PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> "Checkout":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def order(self, order: str, place: int, what: str = "") -> None:
        """Begin a work; its `answer` must be read."""
        assert self.process.stdin is not None
        print(json.dumps([order, place, what]), file=self.process.stdin, flush=True)

    def time(self, place: int, what: str) -> Cost:
        """The cost of one work at a place."""
        self.order(TIME, place, what)
        return Cost(*self.answer())

    def answer(self) -> Any:
        """The next line of the process; the first names the works."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("A checkout cannot measure; its process says why above.")
        return json.loads(line)


def compare(old: Checkout, new: Checkout, places: int, rounds: int, tell: Callable[[float, str], object]) -> Pairs:
    """Both do the same works in turn, once a round; who begins changes from round to round."""
    tell(0.0, "Starting both checkouts")
    whats, _ = old.answer(), new.answer()
    pairs: dict[str, list[tuple[Cost, Cost]]] = {what: [] for what in whats}
    for place in range(places):
        tell(place / places, f"Making the tiles of place {place + 1}/{places}")
        for each in (old, new):
            each.order(WARM, place)
        for each in (old, new):
            each.answer()
        for number in range(rounds):
            tell((place + (number + 1) / (rounds + 1)) / places, f"Timing at place {place + 1}/{places}")
            for what, found in pairs.items():
                costs = {each: each.time(place, what) for each in ((old, new) if number % 2 == 0 else (new, old))}
                found.append((costs[old], costs[new]))
    return pairs


def table(pairs: Pairs) -> str:
    """Medians, and the median ratio of pairs with its 95 % interval, by order statistics of the binomial sign test."""
    from scipy.stats import quantile_test  # takes half a second, which the measured processes need not spend

    rows = ["| what | before | now | ratio, 95 % interval | system's time before; now |", "|---|---|---|---|---|"]
    for what, found in pairs.items():
        ratios = [now.user_s / before.user_s for before, now in found]
        interval = quantile_test(ratios, q=1.0, p=0.5).confidence_interval()
        shown = [
            f"{1000 * statistics.median(each[side][part] for each in found):.3g} ms"
            for part in (0, 1)
            for side in (0, 1)
        ]
        ratio = f"{statistics.median(ratios):.2f} ({interval.low:.2f} to {interval.high:.2f})"
        rows.append(f"| {what} | {shown[0]} | {shown[1]} | {ratio} | {shown[2]}; {shown[3]} |")
    return "\n".join(rows)


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    if len(arguments) == 3 and arguments[0] == MEASURE:
        measure(Path(arguments[1]), int(arguments[2]))
        return 0
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pairs", description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, metavar="OTHER", help="another checkout, its kernel built")
    parser.add_argument("world", type=Path, metavar="WORLD", help="a world that both can open")
    parser.add_argument("--places", type=int, default=PLACES, help="streets that are rendered")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="how often each does everything at a place")
    asked = parser.parse_args(arguments)
    with ExitStack() as stack:
        tell = stack.enter_context(progress("Comparing"))
        old, new = (stack.enter_context(Checkout(root, asked.world, asked.places)) for root in (asked.other, ROOT))
        pairs = compare(old, new, asked.places, asked.rounds, tell)
    print(table(pairs))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
