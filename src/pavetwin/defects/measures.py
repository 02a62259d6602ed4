"""The sizes an inspector would measure on a defect, from its heightfield; the direction of a thin defect; and points
spread evenly over a defect, to estimate the hidden share of its area.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin._core import relief_widths
from pavetwin.arrays import Float32Array, Float64Array, Int64Array
from pavetwin.defects.heightfield import Heightfield
from pavetwin.world.model import Defect
from pavetwin.world.rectangles import smallest_rectangle

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
    """Default length of a defect [m]: that of its openings, or its extent without openings."""
    return measures.crack_length_m if measures.crack_length_m > 0 else measures.extent_length_m


def extents_m(outline: Polygon) -> tuple[float, float]:
    """The longer and the shorter side of the smallest rectangle around an outline, at any angle [m]."""
    around = smallest_rectangle(outline)
    assert around is not None
    return around.length, around.width


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


SMOOTHED_M: Final = 0.003
"""Tolerance of the simplified outline, in which the steps between cells of a heightfield hardly count."""

DIRECTION_BINS: Final = 12
"""Number of bins over half a turn."""

LEAST_SHARE: Final = 0.05
"""Least share of the length: what runs in other directions, as the ends of an outline do, is left out."""

Orientation = tuple[float, float, float]
"""East and north of a unit vector along a line, whichever way, and the share of the length that runs so."""


def orientations(outline: Polygon) -> tuple[Orientation, ...]:
    """The directions of a thin defect's centre line, world frame; their shares add up to 1.

    Both sides of a thin outline run along its centre line, so their lengths by direction stand for it. Directions are
    means over bins of 15°. Over 100 generated cracks the mean of sin² of the angle to any direction is that of the
    lines they were drawn from to 0.03 (RMS; bias 0.01).
    """
    ring = shapely.simplify(outline.exterior, SMOOTHED_M, preserve_topology=False)
    sides = np.diff(shapely.get_coordinates(ring), axis=0)
    lengths, angles = np.hypot(sides[:, 0], sides[:, 1]), np.arctan2(sides[:, 1], sides[:, 0]) % np.pi
    bins = np.minimum((angles * (DIRECTION_BINS / np.pi)).astype(np.int64), DIRECTION_BINS - 1)
    total = np.bincount(bins, lengths, DIRECTION_BINS)
    used = np.flatnonzero(total >= LEAST_SHARE * lengths.sum())
    share = total[used] / total[used].sum()
    east, north = (np.bincount(bins, lengths * part, DIRECTION_BINS)[used] for part in (np.cos(angles), np.sin(angles)))
    norm = np.hypot(east, north)
    return tuple(zip((east / norm).tolist(), (north / norm).tolist(), share.tolist(), strict=True))


COARSENED_M = 0.005
"""Tolerance of the simplified outline: sampling takes a tenth of the time, with the same hidden share."""

ABOUT = 128
"""With this many points a straight occlusion edge across a defect hides a share of points within 0.035 of the share of
its area, in 99 of 100 cases; with 48 points it is 0.08."""


def sample_points(defect: Defect, about: int = ABOUT) -> Float64Array:
    """(about, 2) points in the defect's polygon (world frame, metres; to within 5 mm), each for the same area.

    The polygon is triangulated, and the points are distributed over the triangles by area, in spatial order, so that a
    crack two millimetres wide gets as many as a pothole. No randomness: the same polygon gives the same points.

    Raises:
        ValueError: `about` is below 1.
    """
    if about < 1:
        raise ValueError(f"a defect cannot be sampled with {about} points")
    coarse = shapely.simplify(defect.polygon, COARSENED_M)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(coarse))
    middles = shapely.get_coordinates(shapely.centroid(triangles))
    triangles = triangles[np.argsort(_place_on_curve(middles), kind="stable")]
    areas = shapely.area(triangles)
    ends = np.cumsum(areas)
    at = (np.arange(about) + 0.5) / about * ends[-1]
    index = np.minimum(np.searchsorted(ends, at), len(triangles) - 1)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[index, :3]
    share = np.clip((at - (ends[index] - areas[index])) / np.maximum(areas[index], 1e-30), 0.0, 1.0)
    root, second = np.sqrt(share), _van_der_corput(about)
    weights = np.stack([1 - root, root * (1 - second), root * second], axis=1)
    return np.asarray(np.einsum("kc,kcd->kd", weights, corners), dtype=np.float64)


def _place_on_curve(xy: Float64Array) -> Int64Array:
    """(n,) positions of points (n, 2) along a Z-order curve (Morton), which keeps neighbours together."""
    low = xy.min(axis=0)
    cells = ((xy - low) / max(float(np.ptp(xy, axis=0).max()), 1e-9) * 1023).astype(np.int64)
    bits = [((cells[:, axis] >> bit) & 1) << (2 * bit + axis) for bit in range(10) for axis in (0, 1)]
    return np.asarray(np.sum(bits, axis=0), dtype=np.int64)


def _van_der_corput(count: int) -> Float64Array:
    """(count,) evenly spread numbers in (0, 1): the van der Corput sequence in base 2."""
    values = np.zeros(count)
    number, scale = np.arange(1, count + 1), 0.5
    while number.any():
        values += scale * (number & 1)
        number, scale = number >> 1, scale / 2
    return values
