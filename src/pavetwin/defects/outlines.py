"""Shared by the classes: ranges, and closed outlines whose radius wanders."""

import math
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator
from shapely import Polygon

Points = npt.NDArray[np.float64]


def _ordered(limits: tuple[float, float]) -> tuple[float, float]:
    if not 0 < limits[0] <= limits[1]:
        raise ValueError("expected two positive numbers, the smaller first")
    return limits


Range = Annotated[tuple[float, float], AfterValidator(_ordered)]
"""Least and largest value of a size."""


def between(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    """A number drawn evenly from a range."""
    return float(rng.uniform(*limits))


def wandering_radius(rng: np.random.Generator, count: int, roughness: float, harmonics: int) -> Points:
    """(count,) radii around a circle, 1 on average, from harmonics whose amplitude falls with their number."""
    angles = 2 * math.pi * np.arange(count) / count
    radius = np.ones(count)
    for order in range(2, harmonics + 2):
        amplitude = roughness * float(rng.normal()) / order
        radius += amplitude * np.cos(order * angles + float(rng.uniform(0, 2 * math.pi)))
    return np.asarray(np.clip(radius, 0.4, 1.6), dtype=np.float64)


def fitted(ring: Points, length_m: float, width_m: float) -> Polygon:
    """A ring (n, 2) stretched to measure `length_m` along x and `width_m` along y, its centroid at the origin."""
    extent = ring.max(axis=0) - ring.min(axis=0)
    polygon = Polygon(ring * (np.array([length_m, width_m]) / extent))
    centroid = np.array([polygon.centroid.x, polygon.centroid.y])
    return Polygon(np.asarray(polygon.exterior.coords)[:-1] - centroid)


def turned(ring: Points, angle_rad: float) -> Points:
    """A ring (n, 2) turned anticlockwise about the origin."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.asarray(ring @ np.array([[cos, sin], [-sin, cos]]), dtype=np.float64)
