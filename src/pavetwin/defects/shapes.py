"""Shared helpers of defect classes: ranges, lattices, noise, cracks as lines, and notches.

A crack is a random line with an opening and a depth. A notch is the part that a defect loses to another within it, as a
network of cracks to a pothole. Outlines stay disjoint, so that each place belongs to one label: where the pothole lies,
and `APART_M` around it, the network is lost. The notch opens to the network's border: an outline has no holes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
import shapely
from pydantic import AfterValidator
from shapely import LineString, Point, Polygon
from shapely.affinity import affine_transform

from pavetwin._core import relief_noise, relief_trace
from pavetwin.arrays import Float32Array, Float64Array, IndexArray
from pavetwin.defects.heightfield import Heightfield, Lattice


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if not 0 < limits[0] <= limits[1]:
        raise ValueError("expected two positive numbers, the smaller first")
    return limits


def _ordered_share(limits: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= limits[0] <= limits[1] <= 1:
        raise ValueError("expected two numbers within 0 … 1, the smaller first")
    return limits


Range = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""Least and largest value of a size."""


def counts(least: int, most: int) -> AfterValidator:
    """Refuse ranges beyond these limits or of numbers that are not whole."""

    def check(limits: tuple[int, int]) -> tuple[int, int]:
        if not least <= limits[0] <= limits[1] <= most:
            raise ValueError(f"expected two numbers within {least} … {most}, the smaller first")
        return limits

    return AfterValidator(check)


def limited(least: float, most: float, unit: str = " m") -> AfterValidator:
    """Refuse ranges beyond these limits, such as sizes in centimetres, whose cells would fill the memory, or in
    kilometres, which cells do not show."""

    def check(limits: tuple[float, float]) -> tuple[float, float]:
        if limits[1] > most:
            raise ValueError(f"{limits[1]:g}{unit} is more than the {most:g}{unit} that are possible")
        if limits[0] < least:
            raise ValueError(f"{limits[0]:g}{unit} is less than the {least:g}{unit} that are possible")
        return limits

    return AfterValidator(check)


ShareRange = Annotated[tuple[float, float], AfterValidator(_ordered_share)]
"""Least and largest value of a share."""


def between(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """A number drawn uniformly from a range."""
    return float(rng.uniform(limits[0], limits[1]))


def log_between(limits: tuple[float, float], share: float) -> float:
    """The number at a share of the way through a range, on a logarithmic scale; never outside the range."""
    low, high = limits
    return min(high, max(low, low * math.exp(share * math.log(high / low))))


def lattice_around(low: Float64Array, high: Float64Array, cell_m: float, pad_m: float) -> Lattice:
    """A lattice that covers a box (its corners (2,) in metres) and `pad_m` around it, a cell centred on the origin."""
    first = np.floor((low - pad_m) / cell_m)
    last = np.ceil((high + pad_m) / cell_m)
    cols, rows = (last - first + 1).astype(int).tolist()
    return (rows, cols), cell_m, (float(first[0] * cell_m), float(first[1] * cell_m))


def centres(lattice: Lattice) -> tuple[Float32Array, Float32Array]:
    """The cells' centres: x (1, cols) and y (rows, 1) [m]."""
    (rows, cols), cell, (x0, y0) = lattice
    x = (x0 + cell * np.arange(cols)).astype(np.float32)[None, :]
    y = (y0 + cell * np.arange(rows)).astype(np.float32)[:, None]
    return x, y


def noise(
    rng: np.random.Generator, lattice: Lattice, wave_m: float | tuple[float, float], octaves: int, gain: float = 0.5
) -> Float32Array:
    """Fractal noise (rows, cols) of mean 0 and standard deviation about 1."""
    waves = wave_m if isinstance(wave_m, tuple) else (wave_m, wave_m)
    return relief_noise(lattice, int(rng.integers(2**63)), waves, octaves, gain)


def smooth(field: Float32Array, low: float, high: float) -> Float32Array:
    """Smoothstep: 0 below `low`, 1 above `high`; reversed if `low` is the larger."""
    return np.asarray(np.clip((field - np.float32(low)) / np.float32(high - low), 0, 1), dtype=np.float32)


def turned(ring: Float64Array, angle_rad: float) -> Float64Array:
    """Points (n, 2) rotated anticlockwise about the origin."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.asarray(ring @ np.array([[cos, sin], [-sin, cos]]), dtype=np.float64)


def spread(
    shape: tuple[int, int], cells: IndexArray, values: Float32Array, low: float = 0.0, high: float = 1.0
) -> Float32Array:
    """A field with values at some cells, clipped to the limits, and 0 elsewhere."""
    field = np.zeros(shape, dtype=np.float32)
    field.ravel()[cells] = np.clip(values, low, high)
    return field


STEP_M = 0.006
"""Spacing of a line's points: about the size of the stones that a crack goes around."""

FRAYED = ((1.0, 0.7), (2.6, 0.75), (6.5, 0.6))
"""Spectrum of an edge's deviation: wavelengths in stones, and their amplitudes."""


@dataclass(frozen=True, eq=False)
class Stroke:
    """A line (n, 2) with half its opening to the left and right (n, 2) and its depth (n,) [m]."""

    points: Float64Array
    half_m: Float64Array
    depth_m: Float64Array


@dataclass(frozen=True, eq=False)
class StrokeFields:
    """Rasterised strokes: height [m], share open, distance from the nearest edge [m], each (rows, cols)."""

    height_m: Float32Array
    opening: Float32Array
    distance_m: Float32Array


def traced(lattice: Lattice, strokes: Sequence[Stroke], reach_m: float, steepness: int = 2) -> StrokeFields:
    """Draw strokes on a lattice; `steepness` 1 makes a section V-shaped, large ones U-shaped."""
    lengths = [len(stroke.points) for stroke in strokes]
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.uint32)
    empty = np.empty((0, 2))
    points = np.concatenate([empty, *(stroke.points for stroke in strokes)])
    half = np.concatenate([empty, *(stroke.half_m for stroke in strokes)])
    depth = np.concatenate([np.empty(0), *(stroke.depth_m for stroke in strokes)])
    return StrokeFields(*relief_trace(lattice, points, offsets, half, depth, reach_m, steepness))


def wandering(rng: np.random.Generator, count: int, step_m: float, longest_m: float, hurst: float) -> Float64Array:
    """(count,) lateral deviations along a line, of standard deviation about 1 at a wavelength of one metre.

    Wavelengths are halved from `longest_m` down to three steps; the amplitude grows with the wavelength to the power
    `hurst` (self-affine, as fracture lines are). Waves are piecewise linear: cracks turn at stones, in corners.
    """
    at = np.arange(count) * step_m
    total = np.zeros(count)
    wave = longest_m
    while wave > 3 * step_m:
        knots = rng.normal(size=math.ceil(at[-1] / wave) + 3)
        total += wave**hurst * np.interp(at / wave + rng.random(), np.arange(len(knots)), knots)
        wave /= 2
    return total


def frayed(rng: np.random.Generator, count: int, step_m: float, grain_m: float) -> Float64Array:
    """(count, 2) deviations of the two edges, standard deviation about 1: angular at the size of stones, with
    occasional notches of several stones."""
    sides = np.zeros((count, 2))
    for grain, strength in FRAYED:
        at = np.arange(count) * step_m / (grain * grain_m)
        knots = strength * rng.normal(size=(2, math.ceil(at[-1]) + 3))
        sides += np.stack([np.interp(at + rng.random(), np.arange(knots.shape[1]), side) for side in knots], axis=1)
    return sides


def flaked(rng: np.random.Generator, stroke: Stroke, share: float, size_m: float, depth_m: float) -> Stroke:
    """The spalls of a crack's edges as one stroke: shallow, about `size_m` wide, on `share` of its length."""
    count = len(stroke.points)
    at = np.arange(count) * STEP_M / (1.6 * size_m)
    knots = rng.random((2, math.ceil(at[-1]) + 3))
    bulge = np.stack([np.interp(at + rng.random(), np.arange(knots.shape[1]), side) for side in knots], axis=1)
    # The mean of two neighbouring numbers in [0, 1) is above 1 − s with a probability of about s where s is small.
    outer = size_m * np.sqrt(np.clip((bulge - (1 - 0.75 * share)) / max(0.05, 0.75 * share), 0, 1))
    outer *= rng.uniform(0.6, 1.2, (count, 2))
    return Stroke(stroke.points, np.where(outer > 0, stroke.half_m + outer, 0.0), np.full(count, depth_m))


DEPTH: Final = (0.35, 1.3)
"""Distance from the host's outline to the middle of what lies in it, × half the length of that. Ours."""

MOUTH_M: Final = 0.36
"""Width of the notch where it opens. The closing of a network's label would bridge one of less than 30 cm."""

BEYOND_M: Final = 0.6
"""Reach of the notch beyond the host's outline."""

SPARE_M: Final = 0.015
"""The notch is wider by this than what the label rule adds to the host, and than the distance of outlines."""

LEAST_LEFT: Final = 0.5
"""Share of its area that a host keeps."""

LEAST_AROUND: Final = 0.55
"""Least share of the directions from its middle in which a defect within another has that one next to it."""

REACH_M: Final = 0.35
"""Largest distance of a neighbour from its outline."""

_DIRECTIONS: Final = 36
_ROUNDED_M: Final = 0.001


@dataclass(frozen=True, eq=False)
class Host:
    """A placed defect in which others may lie."""

    shape: Heightfield
    centre: Point
    yaw_rad: float

    def notched(self, outline: Polygon, apart_m: float) -> "Notched | None":
        """The rest of it where another outline lies in it (world frame); None where too little is left, or where it
        is not around the other one."""
        own = _own(outline, self.centre, self.yaw_rad)
        whole = self.shape.outline
        middle = own.centroid
        edge = whole.exterior.interpolate(whole.exterior.project(middle))
        away = np.array([edge.x - middle.x, edge.y - middle.y])
        if not whole.contains(middle) or not np.any(away):
            return None
        out = Point(*(np.array([edge.x, edge.y]) + away / np.hypot(*away) * BEYOND_M))
        room = own.buffer(apart_m + self.shape.marking.margin_m + SPARE_M, quad_segs=4)
        mouth = LineString([middle, out]).buffer(MOUTH_M / 2, cap_style="flat")
        notch = shapely.simplify(shapely.union(room, mouth), 2 * _ROUNDED_M)
        if not isinstance(notch, Polygon) or whole.difference(notch).area < LEAST_LEFT * whole.area:
            return None
        ring = np.round(shapely.get_coordinates(notch.exterior)[:-1] / _ROUNDED_M) * _ROUNDED_M
        cut = tuple((round(x, 3), round(y, 3)) for x, y in ring.tolist())
        left = self.shape.without(np.array(cut))
        if not left.mask.any() or left.outline.area < LEAST_LEFT * whole.area:
            return None
        if left.outline.distance(own) < apart_m or _around(left.outline, own) < LEAST_AROUND:
            return None
        return Notched(left, cut)


@dataclass(frozen=True, eq=False)
class Notched:
    """The rest of a host."""

    shape: Heightfield
    ring: tuple[tuple[float, float], ...]
    """The notch, in the host's own frame [m]."""


def places_in(host: Host, length_m: float, rng: np.random.Generator, count: int) -> Iterator[tuple[float, float]]:
    """World points (x, y) at which the middle of a defect of a length may lie in a host: near its border."""
    whole = host.shape.outline
    for at in rng.random(count).tolist():
        edge = whole.exterior.interpolate(at, normalized=True)
        depth = float(rng.uniform(*DEPTH)) * length_m / 2
        ahead = whole.exterior.interpolate((at + 0.02) % 1, normalized=True)
        back = whole.exterior.interpolate((at - 0.02) % 1, normalized=True)
        along = np.array([ahead.x - back.x, ahead.y - back.y])
        inward = np.array([-along[1], along[0]]) / max(1e-9, float(np.hypot(*along)))
        inward *= 1.0 if whole.exterior.is_ccw else -1.0
        own = np.array([edge.x, edge.y]) + depth * inward
        x, y = turned(own[None], host.yaw_rad)[0] + (host.centre.x, host.centre.y)
        yield float(x), float(y)


def _own(outline: Polygon, centre: Point, yaw_rad: float) -> Polygon:
    """An outline of the world in the frame of a defect."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    x, y = -(cos * centre.x + sin * centre.y), sin * centre.x - cos * centre.y
    return affine_transform(outline, [cos, sin, -sin, cos, x, y])


def _around(host: Polygon, within: Polygon) -> float:
    """Share of the directions from the middle of an outline in which a host lies next to it."""
    middle = np.array(within.centroid.coords[0])
    angles = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    ends: Float64Array = middle + 9.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    rays = shapely.linestrings(np.stack([np.broadcast_to(middle, ends.shape), ends], axis=1))
    beside = shapely.intersection(shapely.difference(rays, within), within.buffer(REACH_M, quad_segs=4))
    return float(shapely.intersects(beside, host).mean())
