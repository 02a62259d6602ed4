"""A part of a world, rotated so that a street is horizontal on the page."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import atan2, cos, sin
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Segment, World

Shape = TypeVar("Shape", bound=shapely.Geometry)
Item = TypeVar("Item", bound=Any)


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
    def _axes(self) -> Float64Array:
        """(2, 2) the page's directions in the world, a column each."""
        c, s = cos(self.angle_rad), sin(self.angle_rad)
        return np.array([[c, -s], [s, c]])

    def points(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) to page (..., 2), metres both."""
        return (np.asarray(xy, dtype=np.float64) - self.origin) @ self._axes

    def back(self, xy: npt.ArrayLike) -> Float64Array:
        """Page (..., 2) to world (..., 2)."""
        return np.asarray(xy, dtype=np.float64) @ self._axes.T + self.origin

    def shape(self, geometry: Shape) -> Shape:
        return shapely.transform(geometry, self.points)

    def world(self, world: World, reach_m: float) -> World:
        """The world within `reach_m` of the origin, on the page. Only its geometry may be used."""
        disc = Point(self.origin).buffer(reach_m)

        def near(items: Iterable[Item], *geometries: str) -> tuple[Item, ...]:
            """Those whose first geometry touches the disc, on the page."""
            return tuple(
                replace(item, **{name: self.shape(getattr(item, name)) for name in geometries})
                for item in items
                if disc.intersects(getattr(item, geometries[0]))
            )

        return replace(
            world,
            streets=near(world.streets, "centre_line"),
            segments=near(world.segments, "polygon", "centre_line"),
            lanes=near(world.lanes, "centre_line"),
            connections=near(world.connections, "centre_line"),
            junctions=near(world.junctions, "polygon"),
            crossings=near(world.crossings, "polygon"),
            buildings=near(world.buildings, "polygon"),
            furniture=tuple(
                replace(item, yaw_rad=item.yaw_rad - self.angle_rad) for item in near(world.furniture, "position")
            ),
            parks=tuple(self.shape(park) for park in world.parks if disc.intersects(park)),
            defects=near(world.defects, "centre", "polygon"),
            base=self.shape(world.base),
        )
