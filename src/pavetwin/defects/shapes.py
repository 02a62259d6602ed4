"""Shared helpers of defect classes: ranges, lattices around shapes, noise."""

import math
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from pavetwin._core import relief_noise
from pavetwin.arrays import Float32Array, Float64Array, IndexArray
from pavetwin.defects.heightfield import Lattice


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
    """Refuse ranges of numbers that are not whole within these."""

    def check(limits: tuple[int, int]) -> tuple[int, int]:
        if not least <= limits[0] <= limits[1] <= most:
            raise ValueError(f"expected two numbers within {least} … {most}, the smaller first")
        return limits

    return AfterValidator(check)


def limited(least: float, most: float, unit: str = " m") -> AfterValidator:
    """Refuse ranges that reach further: sizes in centimetres, say, whose cells would fill the memory, or in kilometres,
    which cells do not show."""

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
