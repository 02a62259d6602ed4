"""The sizes an inspector would measure on a defect, computed from its heightfield."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from pavetwin._core import relief_widths
from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.defects.heightfield import Heightfield

WIDEST_SHARE = 0.98
"""The width is this quantile of the opening over the crack's length, so that single chips do not count."""

BINS = 2000

HOLE_SHARE = 0.15
"""Cells deeper than this share of the depth belong to the hole, not to its broken surroundings."""


@dataclass(frozen=True, slots=True)
class Measures:
    """Sizes of a defect; those of openings are 0 where no cell has one."""

    area_m2: float
    """Area of the outline [m²]."""
    extent_length_m: float
    """Longer side of the smallest rectangle around the outline, at any angle [m]."""
    extent_width_m: float
    """Shorter side of that rectangle [m]."""
    depth_m: float
    """Depth of the deepest cell below the defect-free road [m]."""
    volume_m3: float
    """Volume between the defect and the defect-free road [m³]; what stands above the road does not count."""
    crack_length_m: float
    """Total length of the openings along their centre lines [m]."""
    width_m: float
    """Width of the openings that 2 % of their length exceed [m]: the opening of a crack, not the size of the defect."""
    mean_width_m: float
    """Mean width of the openings over their length [m]."""
    diameter_m: float
    """Diameter of a circle of the area that lies deeper than 15 % of the depth [m]: for round holes. Of a long shape it
    lies between length and width; use `extent_width_m` there."""
    exposed_m2: float
    """Area of broken surface [m²]: the cells' shares `exposed`, added up."""
    sunken_m: float
    """Depth that 5 % of the area between the openings exceeds [m]: blocks that sank, tilted or are lost."""


def length_of(measures: Measures) -> float:
    """The length of a defect unless its class says otherwise [m]: of its openings, or without them its extent."""
    return measures.crack_length_m if measures.crack_length_m > 0 else measures.extent_length_m


def extents_m(outline: Polygon) -> tuple[float, float]:
    """The longer and the shorter side of the smallest rectangle around an outline, at any angle [m]."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline))
    first, second = np.hypot(*np.diff(corners[:3], axis=0).T).tolist()
    return max(first, second), min(first, second)


def measure(heightfield: Heightfield) -> Measures:
    """Measure a defect.

    The width at a cell is found from the chords along x and y through it (see `relief_widths`), which count shares of
    cells; a cell open by the share s then stands for s · cell² / width of crack length.
    """
    cell, height, opening = heightfield.cell_m, heightfield.height_m, heightfield.opening
    depth = max(0.0, -float(height.min()))
    width = relief_widths(opening) * np.float32(cell)
    open_cells = width > 0
    widths = width[open_cells].astype(np.float64)
    lengths = opening[open_cells].astype(np.float64) * cell**2 / widths
    length = float(lengths.sum())
    hole = np.count_nonzero(height < -HOLE_SHARE * depth) if depth > 0 else 0
    between = height[heightfield.mask & (opening == 0)]
    along, across = extents_m(heightfield.outline)
    return Measures(
        area_m2=float(heightfield.outline.area),
        extent_length_m=along,
        extent_width_m=across,
        depth_m=depth,
        volume_m3=-float(np.minimum(height, 0).sum(dtype=np.float64)) * cell**2,
        crack_length_m=length,
        width_m=_quantile(widths, lengths, WIDEST_SHARE) if length > 0 else 0.0,
        mean_width_m=float((widths * lengths).sum() / length) if length > 0 else 0.0,
        diameter_m=2 * math.sqrt(hole * cell**2 / math.pi),
        exposed_m2=float(heightfield.exposed.sum(dtype=np.float64)) * cell**2,
        sunken_m=max(0.0, -_low(between)),
    )


def _quantile(values: Float64Array, weights: Float64Array, share: float) -> float:
    """The value that a share of the weight does not exceed, to within a two-thousandth of the largest."""
    top = float(values.max())
    reached = np.cumsum(np.bincount((values * (BINS / top)).astype(np.int64), weights, minlength=BINS + 1))
    return min(top, (float(np.searchsorted(reached, share * reached[-1])) + 0.5) * top / BINS)


def _low(heights: Float32Array) -> float:
    """The 5th percentile of the heights."""
    if heights.size == 0:
        return 0.0
    return float(np.partition(heights, heights.size // 20)[heights.size // 20])
