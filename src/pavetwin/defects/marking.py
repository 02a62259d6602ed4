"""The rule that derives the labelled region from a heightfield."""

from dataclasses import dataclass

import shapely
from shapely import Polygon

from pavetwin._core import relief_outline, relief_region
from pavetwin.arrays import BoolArray, Float32Array

SIMPLIFIED = 0.3
"""Tolerance of an outline against its mask's boundary [cells]."""


@dataclass(frozen=True, slots=True)
class Marking:
    """The labelled region: everything at least `least_m` below the road, widened by `margin_m` as an annotator's brush
    does, closed by a disc of `closing_m`, without holes; of that the largest connected region.

    Two parts of a crack stay connected across a gap of up to 2 √(margin² + 2 · margin · closing).
    """

    margin_m: float = 0.02
    closing_m: float = 0.05
    least_m: float = 0.0005


def mark(height_m: Float32Array, cell_m: float, marking: Marking) -> BoolArray:
    """The mask (rows, cols) of a heightfield."""
    return relief_region(height_m <= -marking.least_m, marking.margin_m / cell_m, marking.closing_m / cell_m)


def outline(mask: BoolArray, cell_m: float, origin_m: tuple[float, float]) -> Polygon:
    """The boundary of a connected mask without holes, in metres.

    Raises:
        ValueError: the mask is empty.
    """
    ring = relief_outline(mask)
    if len(ring) < 4:
        raise ValueError("an empty mask has no outline")
    whole = Polygon(ring * cell_m + origin_m)
    polygon = shapely.simplify(whole, SIMPLIFIED * cell_m, preserve_topology=False)
    if not (isinstance(polygon, Polygon) and polygon.is_valid):  # rare, and several times slower
        polygon = shapely.simplify(whole, SIMPLIFIED * cell_m)
    assert isinstance(polygon, Polygon)
    return polygon
