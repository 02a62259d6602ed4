"""Cracks as lines with an opening and a depth: their random course, and their heightfield."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pavetwin._core import relief_trace
from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.defects.heightfield import Lattice

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
