"""Where a pavement is paler or darker than the finish of the mesh says.

That is in lanes that were paved apart, and in the patches of defects across the joint of two pavements: a patch has one
finish, that of the pavement in its middle.
"""

from itertools import dropwhile
from typing import Final

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float32Array
from pavetwin.scene.ground.layout.surfaces import tile_box
from pavetwin.scene.ground.maps.raster import RasterGrid, filled
from pavetwin.scene.ground.plan import GroundPlan
from pavetwin.scene.model import MAP_MARGIN_M

STEPS: Final = 128
"""Levels of a factor of 1, as the map itself has them."""


def shades(plan: GroundPlan, key: tuple[int, int], raster: RasterGrid) -> Float32Array | None:
    """Factor on the reflectance of the finish, (px, px), the mean over each cell; None where it is 1 everywhere."""
    box = tile_box(key, MAP_MARGIN_M + 0.1)
    index, surfaces = plan.paved
    shaded = [(index.shapes[number], surfaces[number].shade) for number in index.near(box)]
    shaded += [part for number in plan.holes.near(box) for part in _in_patch(plan, number)]
    drawn = list(dropwhile(lambda part: part[1] == 1.0, shaded))
    if not drawn:
        return None
    rings = [
        (part.exterior, min(255, round(shade * STEPS)))
        for shape, shade in drawn
        for part in shapely.get_parts(shape)
        if isinstance(part, Polygon)
    ]
    return filled(raster, rings, STEPS) / np.float32(STEPS)


def _in_patch(plan: GroundPlan, number: int) -> list[tuple[BaseGeometry, float]]:
    """What is seen of each pavement in a defect's hole, lower ones first, and the factors that make the patch's finish
    as bright as they are; nothing where there is one pavement only."""
    index, surfaces = plan.paved
    rest: BaseGeometry = plan.holes.shapes[number]
    patch = plan.paved_in(number)
    seen: list[tuple[BaseGeometry, float]] = []
    alike = True
    for above in reversed(index.near(rest)):
        surface = surfaces[above]
        alike = alike and surface.material == patch.material
        seen.insert(0, (shapely.intersection(rest, index.shapes[above]), surface.reflectance / patch.bare_reflectance))
        rest = shapely.difference(rest, index.shapes[above])
        if rest.is_empty:
            break
    return [] if alike else seen
