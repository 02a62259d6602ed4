"""A pothole: an irregular round hole."""

import math

import numpy as np
from shapely import Polygon

from pavetwin.config.base import Settings
from pavetwin.defects.outlines import Range, between, fitted, turned, wandering_radius
from pavetwin.defects.registry import register
from pavetwin.world.model import DefectClass

CORNERS = 32
SLENDEREST = 0.65
"""Least ratio of its breadth to its diameter."""


class PotholeParameters(Settings):
    diameter_m: Range = (0.25, 1.0)
    """Of its longest side."""


def pothole(rng: np.random.Generator, parameters: PotholeParameters | None = None) -> Polygon:
    """The outline of a hole, its centroid at the origin, lying in any direction."""
    parameters = parameters or PotholeParameters()
    radius = wandering_radius(rng, CORNERS, roughness=0.22, harmonics=5)
    angles = 2 * math.pi * np.arange(CORNERS) / CORNERS
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    diameter = between(rng, parameters.diameter_m)
    hole = fitted(ring, diameter, diameter * between(rng, (SLENDEREST, 1.0)))
    return Polygon(turned(np.asarray(hole.exterior.coords)[:-1], float(rng.uniform(0, 2 * math.pi))))


register(DefectClass.POTHOLE, pothole, weight=0.3)
