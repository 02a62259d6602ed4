"""The smallest rectangle around a shape, at any angle: its sides and its axis."""

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array


class Rectangle(NamedTuple):
    """A rectangle at any angle."""

    corners: Float64Array
    """(4, 2) in order around it."""
    along: Float64Array
    """(2,) Unit vector along its longer sides."""
    length: float
    """Longer side, in the unit of the shape."""
    width: float
    """Shorter side."""

    @property
    def middle(self) -> Float64Array:
        """(2,)"""
        middle: Float64Array = self.corners.mean(axis=0)
        return middle


def smallest_rectangle(shape: BaseGeometry) -> Rectangle | None:
    """The rectangle of least area around a shape; None for a shape that is a point or a straight line."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))
    if len(corners) < 5:
        return None
    sides = np.diff(corners[:3], axis=0)
    lengths = np.hypot(*sides.T)
    longer = int(np.argmax(lengths))
    length, width = float(lengths[longer]), float(lengths[1 - longer])
    return Rectangle(corners[:4], sides[longer] / length, length, width) if length else None
