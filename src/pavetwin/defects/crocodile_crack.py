"""A crocodile crack: a ragged patch of cracked surface, longer along the wheel path than across it."""

import math

import numpy as np
from shapely import Polygon

from pavetwin.config.base import Settings
from pavetwin.defects.outlines import Range, between, fitted, turned, wandering_radius
from pavetwin.defects.registry import register
from pavetwin.world.model import DefectClass

CORNERS = 48
SQUARENESS = 3.0
"""Exponent of the superellipse that the patch is made from: 2 is an ellipse, large is a rectangle."""


class CrocodileCrackParameters(Settings):
    length_m: Range = (2.5, 3.5)
    """Along the street."""
    width_m: Range = (1.5, 2.5)


def crocodile_crack(rng: np.random.Generator, parameters: CrocodileCrackParameters | None = None) -> Polygon:
    """The outline of a patch, its centroid at the origin; x runs along the street."""
    parameters = parameters or CrocodileCrackParameters()
    angles = 2 * math.pi * np.arange(CORNERS) / CORNERS
    cos, sin = np.cos(angles), np.sin(angles)
    radius = (np.abs(cos) ** SQUARENESS + np.abs(sin) ** SQUARENESS) ** (-1 / SQUARENESS)
    radius *= wandering_radius(rng, CORNERS, roughness=0.18, harmonics=7) * rng.uniform(0.92, 1.0, CORNERS)
    ring = np.stack([radius * cos, radius * sin], axis=1)
    length, width = between(rng, parameters.length_m), between(rng, parameters.width_m)
    patch = fitted(np.asarray(ring), length, width)
    skew = float(rng.normal(0.0, 0.05))
    return Polygon(turned(np.asarray(patch.exterior.coords)[:-1], skew))


register(DefectClass.CROCODILE_CRACK, crocodile_crack, weight=0.2)
