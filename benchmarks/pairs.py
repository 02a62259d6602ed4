"""`python -m benchmarks.pairs OTHER WORLD`: frames and tiles of this checkout beside those of another one.

    git worktree add ../before COMMIT    # and build its kernel: make setup
    python -m benchmarks.pairs ../before WORLD --rounds 12

A process of each checkout renders the same views of one saved world, which both must be able to open, old and new in
turn, so that other work on the machine meets both. Prints the table of docs/reference/performance.md: processor time,
the least of the rounds at each place, its mean over the places, and the ratios of these and of all rounds.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parent.parent
PLACES: Final = 4
TILE_M, ALTITUDE_M, CAMERA_M = 32.0, 10.0, 1.3
SIZE_PX: Final = (640, 640)
MEASURE: Final = "--measure"
"""Of the process of one checkout: it makes one round for each line of its input and prints a line."""

Round = Mapping[str, Sequence[float]]
"""Processor seconds at each place, by what was made."""


def works(folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """What a round makes; by names that a checkout from before street looks has too."""
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
    for segment in longest[: 6 * PLACES : 6]:
        at = 0.4 * segment.centre_line.length
        (x, y), (dx, dy) = point_at(segment.centre_line, at), direction_at(segment.centre_line, at)
        yaw, key = math.atan2(dy, dx), (int(x // TILE_M), int(y // TILE_M))
        above = nadir(camera, (x, y, ALTITUDE_M), yaw_rad=yaw, size_px=SIZE_PX)
        fov_rad = math.radians(50)
        along = look((x, y, CAMERA_M), yaw_rad=yaw, pitch_rad=-0.12, size_px=SIZE_PX, vertical_fov_rad=fov_rad)
        yield f"a UAV's frame from {ALTITUDE_M:g} m", frame(above, labels=False)
        yield "the same with its labels", frame(above, labels=True)
        yield "a car's frame with its labels", frame(along, labels=True)
        yield "the maps of a ground tile", partial(bare.maps, key)
        yield "the meshes and objects of a tile", partial(bare.tile, key)


def measure(folder: Path) -> None:
    """Render rounds as lines of the standard input ask for them."""
    made = list(works(folder))
    for _, work in made:
        work(), work()  # tiles are made and uploaded
    print(flush=True)
    for _ in sys.stdin:
        found: dict[str, list[float]] = {}
        for what, work in made:
            begun = time.process_time()
            work()
            found.setdefault(what, []).append(time.process_time() - begun)
        print(json.dumps(found), flush=True)


class Checkout:
    """A process that measures with the package of one checkout."""

    def __init__(self, root: Path, world: Path) -> None:
        paths = os.pathsep.join([str(root / "src"), str(ROOT)])
        self.process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.pairs", MEASURE, str(world.absolute())],
            env={**os.environ, "PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._answer()

    def __enter__(self) -> "Checkout":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def round(self) -> Round:
        """The times of one round."""
        assert self.process.stdin is not None
        print(file=self.process.stdin, flush=True)
        return dict(json.loads(self._answer()))

    def _answer(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("A checkout cannot measure; its process says why above.")
        return line


def table(before: Sequence[Round], now: Sequence[Round]) -> str:
    """The least of the rounds at each place, the mean of these over the places, and ratios."""
    rows = ["| what | before | now | ratio | of all rounds |", "|---|---|---|---|---|"]
    for what in now[0]:
        old, new = (_times(rounds, what) for rounds in (before, now))
        least = [1000 * sum(map(min, times)) / len(times) for times in (old, new)]
        whole = [sum(map(sum, times)) for times in (old, new)]
        shown = " | ".join(f"{value:.3g} ms" for value in least)
        rows.append(f"| {what} | {shown} | {least[1] / least[0]:.2f} × | {whole[1] / whole[0]:.2f} × |")
    return "\n".join(rows)


def _times(rounds: Sequence[Round], what: str) -> list[tuple[float, ...]]:
    """By place, the times of all rounds."""
    return list(zip(*(each[what] for each in rounds), strict=True))


def main(arguments: Sequence[str]) -> int:
    """The exit code."""
    if len(arguments) == 2 and arguments[0] == MEASURE:
        measure(Path(arguments[1]))
        return 0
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pairs", description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, metavar="OTHER", help="another checkout, its kernel built")
    parser.add_argument("world", type=Path, metavar="WORLD", help="a world that both can open")
    parser.add_argument("--rounds", type=int, default=12, help="how often each renders everything")
    asked = parser.parse_args(arguments)
    before: list[Round] = []
    now: list[Round] = []
    with ExitStack() as stack:
        old, new = (stack.enter_context(Checkout(root, asked.world)) for root in (asked.other, ROOT))
        for number in range(asked.rounds):
            turns = [(old, before), (new, now)]
            for checkout, rounds in turns if number % 2 == 0 else reversed(turns):
                rounds.append(checkout.round())
    print(table(before, now))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
