"""Masks of defects are tight, and the same on every pavement and in every style of streets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import shapely
import yaml

from pavetwin.arrays import BoolArray
from pavetwin.config.named import names_in
from pavetwin.defects import DefectOptions, place
from pavetwin.errors import PaveTwinError
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground.styles import DEFAULT_STYLE, style_names
from pavetwin.scene.ground.styles.pavement import PACKAGE
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import defect_label
from pavetwin.scene.view import View, nadir
from pavetwin.uav.cameras import Camera, find_camera
from pavetwin.world.model import Defect, World
from scenes import tiny
from scenes.stage import light_of

ALTITUDE_M: Final = 10.0
LIGHT: Final = Light(45.0, 140.0)
SEED: Final = 1
BORDER_PX: Final = 1.0

EACH = 1
"""Of every class."""

BESIDE_PX = 0.3
"""Other pixels have their middles this near to the outline: the texels of the masks of shapes."""

pytestmark = pytest.mark.slow


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


def rendered(world: World, style: str, views: Sequence[tuple[Defect, View]]) -> Iterator[Seen]:
    """Each defect in its image."""
    renderer = Renderer(Scene(world, seed=SEED, style=style))
    for defect, view in views:
        labels = light_of(renderer, view, light=LIGHT).labels
        if labels is None:
            raise PaveTwinError("The renderer gave no labels.")
        columns, rows = np.meshgrid(np.arange(view.size_px[0]) + 0.5, np.arange(view.size_px[1]) + 0.5)
        outline = shapely.Polygon(outline_px(view, defect))
        shapely.prepare(outline)
        inside = shapely.contains_xy(outline, columns, rows)
        yield Seen(defect, np.asarray(labels == defect_label(defect.id)), np.asarray(inside))


def styles(folder: Path) -> Mapping[str, str]:
    """The styles besides the default one by name, and one of each pavement alone."""
    found = {f"style {name}": name for name in style_names() if name != DEFAULT_STYLE}
    for name in names_in(PACKAGE, "pavements"):
        only = {"title": name, "main": {name: 1}, "other": {name: 1}}
        path = folder / f"{name}.yaml"
        path.write_text(yaml.safe_dump(only | {"stretches": {"pavements": {name: 1}}}), encoding="utf-8")
        found[f"pavement {name}"] = str(path)
    return found


@cache
def street() -> World:
    segment = tiny.street("street", (0.0, 0.0), (60.0, 0.0))
    mix = {"single_crack": 1.0, "crocodile_crack": 1.0, "pothole": 1.0}
    return tiny.world([segment], place([segment], 3, DefectOptions(population="survey", per_segment=30, mix=mix)))


@cache
def views() -> tuple[tuple[Defect, View], ...]:
    """`EACH` of every class with a view that shows it whole."""
    kinds: dict[str, list[tuple[Defect, View]]] = {}
    for each in whole_defects(street(), find_camera("paper"), 100):
        kinds.setdefault(each[0].kind, []).append(each)
    assert len(kinds) == 3
    return tuple(each for found in kinds.values() for each in found[:EACH])


@cache
def plain() -> tuple[Seen, ...]:
    return tuple(rendered(street(), DEFAULT_STYLE, views()))


def others() -> list[str]:
    """Names as `styles` has them."""
    return [
        *(f"style {name}" for name in style_names() if name != DEFAULT_STYLE),
        *(f"pavement {name}" for name in names_in(PACKAGE, "pavements")),
    ]


def test_masks_hold_the_pixels_whose_middles_lie_in_the_outline() -> None:
    for (defect, view), seen in zip(views(), plain(), strict=True):
        assert seen.mask.sum() > 50
        rows, columns = np.nonzero(seen.mask != seen.outline)
        ring = shapely.Polygon(outline_px(view, defect)).exterior
        away_px = shapely.distance(ring, shapely.points(columns + 0.5, rows + 0.5))
        assert away_px.max(initial=0.0) < BESIDE_PX


@pytest.mark.parametrize("name", others())
def test_a_style_changes_no_pixel_of_a_mask(name: str, tmp_path: Path) -> None:
    found = rendered(street(), styles(tmp_path)[name], views())
    for before, seen in zip(plain(), found, strict=True):
        np.testing.assert_array_equal(seen.mask, before.mask)
