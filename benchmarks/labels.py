"""`python -m benchmarks.labels`: how well masks agree with outlines, and whether streets' looks change them.

    python -m benchmarks.labels --sample 150 --each 40

places damage in the generated town, clears its streets of what stands on them, and renders whole defects from above
with the camera of the paper: for each damage population that many defects, in the default look; the first of them
again in each other look, and with each pavement alone. Printed are the intersection over union of each mask with the
pixels whose centres lie within the projected outline, and the number of pixels that a look changes.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import shapely
import yaml

from pavetwin.arrays import BoolArray
from pavetwin.cli.console import fail, out, progress
from pavetwin.defects import DefectOptions, place
from pavetwin.defects.population import population_names
from pavetwin.errors import PaveTwinError
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground.looks import DEFAULT_LOOK, look_names
from pavetwin.scene.ground.looks.pavement import pavement_names
from pavetwin.scene.light import Light
from pavetwin.scene.model import defect_label
from pavetwin.scene.scene import Scene
from pavetwin.scene.view import View, nadir
from pavetwin.uav.cameras import Camera, find_camera
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.model import Defect, World

ALTITUDE_M: Final = 10.0
LIGHT: Final = Light(45.0, 140.0)
SEED: Final = 1
BORDER_PX: Final = 1.0


@dataclass(frozen=True)
class Seen:
    """A whole defect in an image."""

    defect: Defect
    mask: BoolArray
    outline: BoolArray
    """(rows, columns) each: labelled pixels, and those whose centres lie in the projected outline."""

    @property
    def iou(self) -> float:
        return float((self.mask & self.outline).sum() / (self.mask | self.outline).sum())


def bare_town(population: str) -> World:
    """The generated town with damage, without trees, lamps and the like over it."""
    world = build_world("town", BuildOptions(seed=SEED)).world
    defects = place(world.segments, SEED, DefectOptions(population=population))
    return replace(world, defects=defects, furniture=())


def whole_defects(world: World, camera: Camera, most: int) -> list[tuple[Defect, View]]:
    """Random defects that fit whole into an image from above, each with its view: off its middle and turned."""
    rng = np.random.default_rng(SEED)
    found: list[tuple[Defect, View]] = []
    for number in rng.permutation(len(world.defects)).tolist():
        defect = world.defects[number]
        x, y = np.array([defect.centre.x, defect.centre.y]) + rng.uniform(-0.5, 0.5, 2)
        view = nadir(camera, (x, y, ALTITUDE_M), yaw_rad=float(rng.uniform(0, 2 * np.pi)))
        pixels = outline_px(view, defect)
        if (pixels > BORDER_PX).all() and (pixels < np.array(view.size_px) - BORDER_PX).all():
            found.append((defect, view))
        if len(found) == most:
            break
    return found


def outline_px(view: View, defect: Defect) -> np.ndarray:
    """(n, 2) of its outline on the road."""
    ring = shapely.get_coordinates(defect.polygon.exterior)
    return np.asarray(view.project(np.column_stack([ring, np.zeros(len(ring))])))


def rendered(world: World, look: str, views: Sequence[tuple[Defect, View]]) -> Iterator[Seen]:
    """Each defect in its image."""
    renderer = Renderer(Scene(world, seed=SEED, look=look))
    for defect, view in views:
        labels = renderer.light(view, light=LIGHT).labels
        if labels is None:
            raise PaveTwinError("The renderer gave no labels.")
        columns, rows = np.meshgrid(np.arange(view.size_px[0]) + 0.5, np.arange(view.size_px[1]) + 0.5)
        outline = shapely.Polygon(outline_px(view, defect))
        shapely.prepare(outline)
        inside = shapely.contains_xy(outline, columns, rows)
        yield Seen(defect, np.asarray(labels == defect_label(defect.id)), np.asarray(inside))


def looks(folder: Path) -> Mapping[str, str]:
    """The looks besides the default one by name, and one of each pavement alone."""
    found = {f"look {name}": name for name in look_names() if name != DEFAULT_LOOK}
    for name in pavement_names():
        only = {"title": name, "main": {name: 1}, "other": {name: 1}}
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(only | {"stretches": {"pavements": {name: 1}}}), encoding="utf-8")
        found[f"pavement {name}"] = str(path)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.labels", description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, default=150, help="defects of each population (150)")
    parser.add_argument("--each", type=int, default=40, help="of the first population, in each other look (40)")
    options = parser.parse_args(arguments)
    camera = find_camera("paper")
    first: tuple[World, list[tuple[Defect, View]], list[Seen]] | None = None
    try:
        for population in sorted(population_names(), reverse=True):
            world = bare_town(population)
            views = whole_defects(world, camera, options.sample)
            seen: list[Seen] = []
            with progress(f"rendering damage of {population}") as tell:
                for each in rendered(world, DEFAULT_LOOK, views):
                    seen.append(each)
                    tell(len(seen) / len(views))
            out.print(f"population {population}: {told(seen)}")
            for kind in sorted({each.defect.kind for each in seen}):
                out.print(f"    {kind}: {told([each for each in seen if each.defect.kind == kind])}")
            first = first or (world, views[: options.each], seen)
        if first is None:
            return 0
        world, views, before = first
        with tempfile.TemporaryDirectory() as folder:
            for name, look in looks(Path(folder)).items():
                pairs = zip(before, rendered(world, look, views), strict=False)
                changed = sum(int((a.mask != b.mask).sum()) for a, b in pairs)
                out.print(f"{name}: {changed} pixels of {len(views)} masks changed")
    except PaveTwinError as error:
        fail(str(error))
        return 2
    return 0


def told(seen: Sequence[Seen]) -> str:
    """Number of defects, mean and least the intersection over union."""
    values = np.array([each.iou for each in seen])
    return f"{len(values)} defects, {values.mean():.3f} on average, {values.min():.3f} at least"


if __name__ == "__main__":
    sys.exit(main())
