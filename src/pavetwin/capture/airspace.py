"""Where the UAV may be while it takes an image, at any altitude: the flight domain without its baked NavMesh."""

from dataclasses import dataclass
from typing import Self

import shapely

from pavetwin.config.mission import VERTICAL_CLEARANCE_M, UavSettings
from pavetwin.navigation.navmesh import corridors
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, solids


@dataclass(frozen=True)
class Airspace:
    """The road corridors, and what stands in them."""

    corridors: shapely.Geometry
    """Less the UAV's radius; prepared."""
    standing: Solids
    bases: shapely.STRtree
    """(n,) of the solids."""
    radius_m: float
    """Of the UAV."""

    @classmethod
    def of(cls, world: World) -> Self:
        standing, radius_m = solids(world), UavSettings().radius_m
        free = shapely.buffer(corridors(world), -radius_m, quad_segs=4)
        shapely.prepare(free)
        bases = shapely.STRtree([shapely.Polygon(standing.base(index)) for index in range(len(standing))])
        return cls(free, standing, bases, radius_m)

    def contains(self, x_m: float, y_m: float, altitude_m: float) -> bool:
        """Whether the UAV fits in there: within a corridor, and clear of what reaches into its altitude ± clearance."""
        place = shapely.Point(x_m, y_m)
        if not shapely.contains(self.corridors, place):
            return False
        near = self.bases.query(place, predicate="dwithin", distance=self.radius_m)
        low, high = altitude_m - VERTICAL_CLEARANCE_M, altitude_m + VERTICAL_CLEARANCE_M
        return not ((self.standing.z0[near] < high) & (self.standing.z1[near] > low)).any()
