"""Masks of defects are tight, and the same on every pavement and in every look of streets."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from benchmarks.labels import Seen, looks, outline_px, rendered, whole_defects

from pavetwin.defects import DefectOptions, place
from pavetwin.scene.ground.looks import DEFAULT_LOOK, look_names
from pavetwin.scene.ground.looks.pavement import pavement_names
from pavetwin.scene.view import View
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import Defect, World
from scenes import tiny

EACH = 1
"""Of every class."""

BESIDE_PX = 0.3
"""Other pixels have their middles this near to the outline: the texels of the masks of shapes."""

pytestmark = pytest.mark.slow


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
    return tuple(rendered(street(), DEFAULT_LOOK, views()))


def others() -> list[str]:
    """Names as `looks` has them."""
    return [
        *(f"look {name}" for name in look_names() if name != DEFAULT_LOOK),
        *(f"pavement {name}" for name in pavement_names()),
    ]


def test_masks_hold_the_pixels_whose_middles_lie_in_the_outline() -> None:
    for (defect, view), seen in zip(views(), plain(), strict=True):
        assert seen.mask.sum() > 50
        rows, columns = np.nonzero(seen.mask != seen.outline)
        ring = shapely.Polygon(outline_px(view, defect)).exterior
        away_px = shapely.distance(ring, shapely.points(columns + 0.5, rows + 0.5))
        assert away_px.max(initial=0.0) < BESIDE_PX


@pytest.mark.parametrize("name", others())
def test_a_look_changes_no_pixel_of_a_mask(name: str, tmp_path: Path) -> None:
    found = rendered(street(), looks(tmp_path)[name], views())
    for before, seen in zip(plain(), found, strict=True):
        np.testing.assert_array_equal(seen.mask, before.mask)
