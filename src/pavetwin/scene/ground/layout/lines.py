"""Geometry of lines: stations, directions, bounds, and positions along the kerbs of a carriageway."""

from collections.abc import Iterable
from typing import Final

import numpy as np
import numpy.typing as npt
import shapely
from shapely import LineString, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.arrays import Float64Array


def ways_along(coords: Float64Array) -> Float64Array:
    """(n,) way along a line to each of its points (n, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(coords, axis=0).T))])


def direction(line: LineString, station_m: float) -> tuple[float, float]:
    """Unit direction (dx, dy) of a line at a station, over one metre."""
    low = max(0.0, min(station_m - 0.5, line.length - 1.0))
    a, b = line.interpolate(low), line.interpolate(min(line.length, low + 1.0))
    length = float(np.hypot(b.x - a.x, b.y - a.y)) or 1.0
    return (b.x - a.x) / length, (b.y - a.y) / length


def rotated(points: Float64Array, turn_rad: float) -> Float64Array:
    """Points (n, 2) turned anticlockwise about the origin."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.asarray(points @ np.array([[cos, sin], [-sin, cos]]))


def boxes_of(lines: Iterable[Float64Array]) -> tuple[Float64Array, Float64Array]:
    """Lower and upper corners (n, 2) of lines."""
    listed = list(lines)
    if not listed:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return np.array([line.min(axis=0) for line in listed]), np.array([line.max(axis=0) for line in listed])


class LineFrame:
    """Coordinates along a line and to its left [m]."""

    def __init__(self, line: LineString) -> None:
        self._coords = shapely.get_coordinates(line)
        self._ways = ways_along(self._coords)

    def points(self, along: npt.ArrayLike, left: npt.ArrayLike) -> Float64Array:
        """World points (..., 2) of stations and offsets to the left; straight on beyond the line's ends."""
        s, d = np.asarray(along, dtype=np.float64), np.asarray(left, dtype=np.float64)
        leg = np.clip(np.searchsorted(self._ways, s, side="right") - 1, 0, len(self._ways) - 2)
        span = self._coords[leg + 1] - self._coords[leg]
        unit = span / np.maximum(np.hypot(span[..., 0], span[..., 1]), 1e-9)[..., None]
        foot = self._coords[leg] + unit * (s - self._ways[leg])[..., None]
        return np.asarray(foot + np.stack([-unit[..., 1], unit[..., 0]], axis=-1) * d[..., None])


_CHUNK: Final = 12  # Segments of an edge that are indexed together


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
        """For points (n, 2), the distance along the nearest ring, that ring's length, and the distance from it [m]."""
        points = shapely.points(xy)
        piece = self.tree.nearest(points)
        lines = self.pieces[piece]
        way = self.begins[piece] + shapely.line_locate_point(lines, points)
        return way, self._lengths[piece], shapely.distance(lines, points)
