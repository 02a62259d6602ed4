"""Place of take-off and landing."""

from dataclasses import replace

import numpy as np
import shapely
from shapely import Point
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from pavetwin.config.mission import VERTICAL_CLEARANCE_M
from pavetwin.errors import PaveTwinError
from pavetwin.navigation.navmesh import CORRIDOR_MARGIN_M
from pavetwin.world.georeference import from_wgs84
from pavetwin.world.model import LaneKind, World
from pavetwin.world.solids import SolidKind, Solids, solids

CLEARANCE_M = 1.0
"""Distance from the UAV to the kerb and to everything that stands next to it."""

BAKING_LOSS_M = 0.5
"""Largest loss of width of a baked mesh relative to the flight domain."""

REACHES_M = (100.0, 500.0)
"""Search radii around the world's base for a place next to the carriageway, in order."""

IN_DEGREES_M = 2000.0
"""Two numbers are read as degrees if their place is this near to a street."""

NOT_IN_METRES_M = 100.0
"""Two numbers that may be degrees are not read as metres this far from a street."""


def roadside(world: World, radius_m: float, standing: Solids) -> Point:
    """The place next to the carriageway that is nearest to the world's base and can be reached at every altitude.

    The UAV keeps `CLEARANCE_M` from the kerb, from standing objects of any height, and from parking places, and avoids
    sidewalks if possible. Without a free place the result is the world's base.
    """
    for reach_m in REACHES_M:
        free = _roadside(world, radius_m, standing, reach_m)
        if not free.is_empty:
            place, _ = nearest_points(free, world.base)
            return Point(round(place.x, 2), round(place.y, 2))
    return world.base


def with_roadside_base(world: World, radius_m: float) -> World:
    """The world with the base of missions of the preset `default`, for maps."""
    return replace(world, base=roadside(world, radius_m, solids(world)))


def _roadside(world: World, radius_m: float, standing: Solids, reach_m: float) -> BaseGeometry:
    keep_m = radius_m + CLEARANCE_M
    around = world.base.buffer(reach_m)
    surfaces = np.array(_carriageways(world))
    near = surfaces[shapely.dwithin(surfaces, world.base, reach_m + 2 * CORRIDOR_MARGIN_M)]
    carriageway = shapely.union_all(near)
    places = [place.polygon for place in world.parking if place.centre.dwithin(world.base, reach_m + 2 * keep_m)]
    bases = np.array([*_bases_near(standing, world.base, reach_m + keep_m), *places])
    blocked = shapely.union_all(shapely.buffer(bases, keep_m)) if len(bases) else Point()
    within = carriageway.buffer(CORRIDOR_MARGIN_M - radius_m - BAKING_LOSS_M).intersection(around).difference(blocked)
    connected = min(shapely.get_parts(within), key=world.base.distance, default=Point())
    beside = connected.difference(carriageway.buffer(keep_m + 0.01))  # for rounding
    walks = [
        lane.centre_line.buffer(lane.width_m / 2 + radius_m)
        for lane in world.lanes_of(LaneKind.SIDEWALK)
        if lane.centre_line.dwithin(world.base, reach_m)
    ]
    off_walks = beside.difference(shapely.union_all(walks))
    return beside if off_walks.is_empty else off_walks


def _carriageways(world: World) -> list[BaseGeometry]:
    return [*(segment.polygon for segment in world.segments), *(junction.polygon for junction in world.junctions)]


def _bases_near(standing: Solids, place: Point, reach_m: float) -> list[shapely.Polygon]:
    if not len(standing):
        return []
    low = np.minimum.reduceat(standing.xy, standing.offsets[:-1])
    high = np.maximum.reduceat(standing.xy, standing.offsets[:-1])
    here = np.array([place.x, place.y])
    near = ((low < here + reach_m) & (high > here - reach_m)).all(axis=1)
    return [shapely.Polygon(standing.base(int(index))) for index in np.flatnonzero(near)]


def check_base(world: World, base: Point, altitude_m: float, radius_m: float, standing: Solids) -> None:
    """Check that the UAV can rise from a place to its altitude and is over the streets there.

    Raises:
        PaveTwinError: something is in the way; the message names it.
    """
    where = f"`base` {base.x:g},{base.y:g}"
    aside_m = _from_streets(world, base)
    if aside_m > CORRIDOR_MARGIN_M - radius_m - BAKING_LOSS_M:
        raise PaveTwinError(
            f"{where}: the nearest street is {aside_m:.1f} m away, and the UAV flies over streets and up to "
            f"{CORRIDOR_MARGIN_M - radius_m - BAKING_LOSS_M:g} m next to them; choose a place nearer to one."
        )
    for index in standing.between(0.0, altitude_m + VERTICAL_CLEARANCE_M).tolist():
        if shapely.Polygon(standing.base(index)).dwithin(base, radius_m):
            thing = SolidKind(standing.kind[index]).name.lower().replace("_", " ")
            raise PaveTwinError(f"{where}: a standing object leaves no room ({thing}); choose a free place.")


def parse_base(text: str, world: World) -> Point:
    """A place from `LAT,LON` in degrees or `x,y` in metres of the world's frame.

    Two numbers are degrees if they name a place in the world.

    Raises:
        PaveTwinError: the text is not two numbers, or they may be degrees and name no place near a street either way.
    """
    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise PaveTwinError(
            f"`base` {text}: expected LAT,LON in degrees, as in 52.47,13.44, or x,y in metres of the world's frame."
        ) from None
    if abs(first) <= 90 and abs(second) <= 180:
        east, north = from_wgs84(world.georeference, (second, first)).tolist()
        place = Point(round(east, 2), round(north, 2))
        away_m = _from_streets(world, place)
        if away_m <= IN_DEGREES_M:
            return place
        aside_m = _from_streets(world, Point(first, second))
        if aside_m > NOT_IN_METRES_M:
            raise PaveTwinError(
                f"`base` {text}: in degrees it is {away_m / 1000:,.0f} km from the nearest street of the world, in "
                f"metres of its frame {aside_m:,.0f} m; choose a place next to a street."
            )
    return Point(first, second)


def _from_streets(world: World, place: Point) -> float:
    return min(surface.distance(place) for surface in _carriageways(world))
