"""What an inspector would measure on a defect, taken from its heightfield."""

import math
from dataclasses import dataclass

import numpy as np

from pavetwin._core import relief_widths
from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.defects.heightfield import Heightfield

WIDEST_SHARE = 0.98
"""The widest opening is the one that this share of the crack's length does not exceed: a chip is no width."""

BINS = 2000

HOLE_SHARE = 0.15
"""What lies deeper than this share of the depth belongs to the hole, not to its frayed surroundings."""


@dataclass(frozen=True, slots=True)
class Measures:
    """Sizes in metres and their powers; lengths and widths of openings are 0 where nothing is open."""

    area_m2: float
    """Of the outline."""
    depth_m: float
    """At the deepest."""
    volume_m3: float
    """Below the road's height."""
    crack_length_m: float
    """Of all openings together, along their middle."""
    width_m: float
    """Of the openings: exceeded by 2 % of their length."""
    mean_width_m: float
    diameter_m: float
    """Of a circle of the area that lies deeper than 15 % of the depth."""
    exposed_m2: float
    """Of broken surface."""
    sunken_m: float
    """Height below the road that 5 % of the area between the openings exceeds: blocks that sank, tilted or are lost."""


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
    return Measures(
        area_m2=float(heightfield.outline.area),
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
    """The height that 5 % of the cells lie below."""
    if heights.size == 0:
        return 0.0
    return float(np.partition(heights, heights.size // 20)[heights.size // 20])
