"""The carriageway's edges with stations: the position of a point along its kerb."""

from typing import Final

import numpy as np
import shapely
from shapely import LineString, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.lines import ways_along

_CHUNK: Final = 12
"""Segments of an edge that are indexed together."""


class Edges:
    """The rings around a surface in short pieces, the surface on their left, each with where it begins on its ring."""

    def __init__(self, surface: BaseGeometry) -> None:
        pieces: list[LineString] = []
        begins: list[float] = []
        lengths: list[float] = []
        for polygon in shapely.get_parts(surface):
            for number, ring in enumerate(shapely.get_rings(polygon)):
                coords = shapely.get_coordinates(ring)
                if shapely.is_ccw(ring) != (number == 0):
                    coords = coords[::-1]
                ways = ways_along(coords)
                for first in range(0, len(coords) - 1, _CHUNK):
                    pieces.append(LineString(coords[first : first + _CHUNK + 1]))
                    begins.append(float(ways[first]))
                    lengths.append(float(ways[-1]))
        self.pieces = np.array(pieces, dtype=object)
        self.begins = np.array(begins)
        self._lengths = np.array(lengths)
        self.tree = STRtree(pieces)

    def locate(self, xy: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """For points (n, 2) the way along the nearest ring, that ring's length, and the distance from it [m]."""
        points = shapely.points(xy)
        piece = self.tree.nearest(points)
        lines = self.pieces[piece]
        way = self.begins[piece] + shapely.line_locate_point(lines, points)
        return way, self._lengths[piece], shapely.distance(lines, points)
