"""The demo town: a bent main street, side streets of different widths, signals, a park, houses along the streets.

`plan_town` draws the streets, `plan_roads` gives them lanes and names, `place_buildings` lines them with houses. Here
all are moved into the world frame, the whole town to the north-east of the origin.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType

from shapely import Polygon
from shapely.affinity import translate

from pavetwin.world.model import Building
from pavetwin.world.street_graph import Coordinate
from pavetwin.world.town_buildings import largest, place_buildings, surfaces
from pavetwin.world.town_edge import RADIUS_M
from pavetwin.world.town_plan import TownPlan, plan_town
from pavetwin.world.town_roads import RoadPlan, plan_roads, with_parking

SHIFT_M: Coordinate = (RADIUS_M + 10.0, RADIUS_M + 10.0)
"""From the plan's frame, whose origin is the main crossing, to the world frame [m]."""


@dataclass(frozen=True, slots=True)
class Town:
    """A town ready for netconvert; `parks` and `buildings` are in the world frame, `roads` in the plan's."""

    roads: RoadPlan
    parks: tuple[Polygon, ...]
    buildings: tuple[Building, ...]


def build_town(seed: int, parking_m: Mapping[str, float] = MappingProxyType({})) -> Town:
    """The town of a seed; needs no SUMO.

    Args:
        parking_m: width of the wider parking lane of each road that has one: its buildings stand that much further off.
    """
    plan, narrow = _planned(seed)
    roads = with_parking(narrow, parking_m)
    park = largest(plan.park.difference(surfaces(roads)).buffer(-3).buffer(3, join_style="mitre"))
    placed = place_buildings(plan, roads, park, seed)
    buildings = tuple(replace(house, polygon=_moved(house.polygon)) for house in placed)
    return Town(roads, (_moved(park),), buildings)


@lru_cache(maxsize=1)
def _planned(seed: int) -> tuple[TownPlan, RoadPlan]:
    """Asked for twice while a town is built: without parking lanes and with them."""
    plan = plan_town(seed)
    return plan, plan_roads(plan, seed)


def _moved(polygon: Polygon) -> Polygon:
    """A polygon in the world frame, to the centimetre."""
    shifted = translate(polygon, *SHIFT_M)
    return Polygon([(round(x, 2), round(y, 2)) for x, y in shifted.exterior.coords])
