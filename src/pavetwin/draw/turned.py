"""A part of a world, rotated so that a street is horizontal on the page."""

from dataclasses import dataclass, replace
from math import atan2, cos, sin
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Segment, World

Shape = TypeVar("Shape", bound=shapely.Geometry)


@dataclass(frozen=True, slots=True)
class MapTransform:
    """From the world frame to the page: the place `origin` comes to (0, 0), the direction `angle_rad` to the right."""

    origin: tuple[float, float]
    angle_rad: float

    @staticmethod
    def along(segment: Segment) -> "MapTransform":
        """With the middle of a segment's box at the origin, its ends level, running to the right or upwards."""
        line = shapely.get_coordinates(segment.centre_line)
        chord = line[-1] - line[0]
        angle = atan2(float(chord[1]), float(chord[0]))
        if cos(angle) < -1e-9:
            angle += np.pi
        plain = MapTransform((0.0, 0.0), angle)
        low, high = np.reshape(plain.shape(segment.polygon).bounds, (2, 2))
        middle = plain.back((low + high) / 2)
        return MapTransform((float(middle[0]), float(middle[1])), angle)

    @property
    def north_rad(self) -> float:
        """The direction of north on the page, counter-clockwise from its right."""
        return np.pi / 2 - self.angle_rad

    def points(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) to page (..., 2), metres both."""
        given = np.asarray(xy, dtype=np.float64)
        east, north = np.moveaxis((given if given.size else given.reshape(0, 2)) - self.origin, -1, 0)
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        return np.stack([c * east + s * north, c * north - s * east], axis=-1)

    def back(self, xy: npt.ArrayLike) -> Float64Array:
        """Page (..., 2) to world (..., 2)."""
        right, up = np.moveaxis(np.asarray(xy, dtype=np.float64), -1, 0)
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        return np.stack([c * right - s * up, s * right + c * up], axis=-1) + self.origin

    def shape(self, geometry: Shape) -> Shape:
        return shapely.transform(geometry, self.points)

    def world(self, world: World, reach_m: float) -> World:
        """The world within `reach_m` of the origin, on the page. Only its geometry may be used."""
        disc = Point(self.origin).buffer(reach_m)

        def near(geometry: shapely.Geometry) -> bool:
            return bool(disc.intersects(geometry))

        shape = self.shape
        return replace(
            world,
            streets=tuple(replace(s, centre_line=shape(s.centre_line)) for s in world.streets if near(s.centre_line)),
            segments=tuple(
                replace(s, polygon=shape(s.polygon), centre_line=shape(s.centre_line))
                for s in world.segments
                if near(s.polygon)
            ),
            lanes=tuple(replace(e, centre_line=shape(e.centre_line)) for e in world.lanes if near(e.centre_line)),
            connections=tuple(
                replace(c, centre_line=shape(c.centre_line)) for c in world.connections if near(c.centre_line)
            ),
            junctions=tuple(replace(j, polygon=shape(j.polygon)) for j in world.junctions if near(j.polygon)),
            crossings=tuple(replace(c, polygon=shape(c.polygon)) for c in world.crossings if near(c.polygon)),
            buildings=tuple(replace(b, polygon=shape(b.polygon)) for b in world.buildings if near(b.polygon)),
            furniture=tuple(
                replace(f, position=shape(f.position), yaw_rad=f.yaw_rad - self.angle_rad)
                for f in world.furniture
                if near(f.position)
            ),
            parks=tuple(shape(park) for park in world.parks if near(park)),
            defects=tuple(
                replace(d, centre=shape(d.centre), polygon=shape(d.polygon)) for d in world.defects if near(d.centre)
            ),
            base=shape(world.base),
        )
