"""The drivable road: the wheels on the carriageway, the body clear of standing objects."""

from collections.abc import Iterator
from math import atan2
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon, STRtree

from pavetwin.driving.car import BODY, CarLimits, CarState
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import parked_solids
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import LaneKind, World
from pavetwin.world.solids import solids

RIM_M: Final = 0.3
"""A wheel may be this far beyond the carriageway's edge, which bridges gaps between surfaces: a gutter's width."""

LOWEST_M: Final = 0.2
"""Solids that reach no higher than this, or begin above the car, are not obstacles."""

START_EVERY_M: Final = 2.0
"""Distance between possible starting places on a lane."""

ASIDE: Final = (0.0, 0.25, -0.25, 0.5, -0.5, 1.0, -1.0)
"""Changes of the steering, as shares of full lock, by which the kerb turns the wheels."""


class DrivableRoad:
    """Carriageways and junctions of a world, with all standing objects, including parked vehicles."""

    def __init__(self, world: World, parked: ParkedVehicles, limits: CarLimits) -> None:
        self._world, self._limits = world, limits
        surfaces = [*(each.polygon for each in world.segments), *(each.polygon for each in world.junctions)]
        self._surfaces = STRtree(surfaces)
        standing = solids(world).with_others(parked_solids(parked))
        in_the_way = standing.between(LOWEST_M, BODY.height_m)
        self._obstacles = STRtree([Polygon(standing.base(int(number))) for number in in_the_way])

    def holds(self, state: CarState) -> bool:
        """True if all four wheels are on the road and nothing is in the body's way."""
        half_m, side_m = self._limits.wheelbase_m / 2, self._limits.track_m / 2
        wheels = shapely.points([state.place(a, b) for a in (half_m, -half_m) for b in (side_m, -side_m)])
        on_road = self._surfaces.query(wheels, predicate="dwithin", distance=RIM_M)[0]
        return len(np.unique(on_road)) == len(wheels) and not len(self._obstacles.query(body(state), "intersects"))

    def start(self, street: str | None) -> CarState:
        """Start of a drive: on a lane, along it, with nothing in the way.

        Args:
            street: id of the segment, for a start as near to its beginning as there is room; by default the lane
                nearest to the place of take-off.

        Raises:
            PaveTwinError: no lane has room for a car.
        """
        world = self._world
        near = world.base if street is None else world.segment(street).centre_line.interpolate(0.5, normalized=True)
        lanes = [lane for lane in world.lanes if lane.kind is LaneKind.DRIVING]
        own = set() if street is None else set(world.segment(street).edges)
        lanes.sort(key=lambda lane: (lane.edge not in own, lane.centre_line.distance(near)))
        for lane in lanes:
            for state in _places(lane.centre_line, None if lane.edge in own else near):
                if self.holds(state):
                    return state
        raise PaveTwinError(f"No lane of '{world.name}' has room for a car; parked vehicles or houses are in the way.")


def body(state: CarState) -> Polygon:
    """The car's outline on the ground."""
    along, across = BODY.length_m / 2, BODY.width_m / 2
    corners = ((along, across), (-along, across), (-along, -across), (along, -across))
    return Polygon([state.place(a, b) for a, b in corners])


def _places(line: shapely.LineString, near: Point | None) -> Iterator[CarState]:
    """Places along a lane, nearest to a point first; without a point, from the start of the lane."""
    stations = np.arange(BODY.length_m, max(BODY.length_m, line.length - BODY.length_m) + 1e-9, START_EVERY_M).tolist()
    if near is not None:
        stations.sort(key=lambda station: float(line.interpolate(station).distance(near)))
    for station in stations:
        here, ahead = line.interpolate(station), line.interpolate(min(line.length, station + 1.0))
        if here.equals(ahead):
            continue
        yield CarState(here.x, here.y, atan2(ahead.y - here.y, ahead.x - here.x))
