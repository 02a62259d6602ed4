"""The flight domain at an altitude: road corridors minus the obstacles at that height."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Geometry, Polygon

from pavetwin.arrays import Float64Array, UInt32Array
from pavetwin.config.altitude import VERTICAL_CLEARANCE_M, check_altitude
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, solids

CORRIDOR_MARGIN_M = 4.0
"""How far the corridor reaches beyond the carriageway and the junctions."""


@dataclass(frozen=True)
class FlightDomain:
    """The free plane at one altitude, in the world frame."""

    altitude_m: float
    surface: Geometry
    """Polygon or MultiPolygon, valid, not empty."""

    def triangles(self) -> tuple[Float64Array, UInt32Array]:
        """The surface as a triangle list: vertices (n, 2) in metres, triangles (m, 3) into them."""
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(self.surface))
        corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        return vertices, index.reshape(-1, 3).astype(np.uint32)


def corridors(world: World) -> Geometry:
    """Segments and junctions, widened by the corridor's margin."""
    surfaces = [segment.polygon for segment in world.segments] + [junction.polygon for junction in world.junctions]
    return shapely.union_all(shapely.buffer(surfaces, CORRIDOR_MARGIN_M, quad_segs=4))


def obstacles(standing: Solids, altitude_m: float) -> list[Polygon]:
    """The bases of all solids that reach into altitude ± clearance."""
    met = standing.between(altitude_m - VERTICAL_CLEARANCE_M, altitude_m + VERTICAL_CLEARANCE_M)
    return [Polygon(standing.base(int(index))) for index in met]


def flight_domain(world: World, altitude_m: float, standing: Solids | None = None) -> FlightDomain:
    """The flight domain of a world at an altitude.

    Raises:
        PaveTwinError: the altitude is outside the limits, or no free area is left.
    """
    check_altitude(altitude_m)
    blocked = obstacles(standing if standing is not None else solids(world), altitude_m)
    surface = shapely.difference(corridors(world), shapely.union_all(blocked)) if blocked else corridors(world)
    polygons = [part for part in shapely.get_parts(surface) if isinstance(part, Polygon) and part.area > 1.0]
    if not polygons:
        raise PaveTwinError(
            f"`altitude_m` {altitude_m:g}: nothing is left to fly in over '{world.name}'; "
            "every corridor is built over. Choose another altitude."
        )
    return FlightDomain(altitude_m, shapely.simplify(shapely.union_all(polygons), 0.02))
