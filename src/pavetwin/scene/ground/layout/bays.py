"""Parking bays beside the carriageway: level with it, paved, with the kerb behind them."""

from collections.abc import Iterable
from typing import Final

import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.world.model import World
from pavetwin.world.parking import ParkingPosition

MARGIN_M: Final = 0.2
"""A bay reaches this far beyond its places: ours."""

GAP_M: Final = 2.0
"""Bays are joined to the carriageway and to each other over gaps of up to this width: ours."""

BEHIND_M: Final = 2.0
"""Width of the pavement behind a bay, which the bay takes from the sidewalk at the carriageway: ours."""


def bays_of(world: World) -> BaseGeometry:
    """The bays of a world: its places at the street's side, joined to the carriageway, without that; world frame.

    Empty where no place lies in a bay.
    """
    places = in_bays(world)
    if not places:
        return Polygon()
    wide = shapely.union_all([shape for shape, _ in places]).buffer(MARGIN_M, join_style="mitre")
    near = shapely.intersection(world.carriageway, wide.buffer(GAP_M, quad_segs=2))
    joined = _closed(shapely.union(wide, near))
    beside = shapely.intersection(joined, wide.buffer(GAP_M, join_style="mitre"))
    return _areas(shapely.difference(beside, shapely.union_all([world.carriageway, *_houses(world, beside)])))


def in_bays(world: World) -> list[tuple[Polygon, str]]:
    """The places that lie in a bay, each with the id of its segment."""
    bay = ParkingPosition.STREET_SIDE
    return [(place.polygon, place.segment) for place in world.parking if place.position is bay]


def on_sidewalks(world: World) -> list[Polygon]:
    """The places that lie on a sidewalk, at least with two wheels: paved at its height."""
    on_kerb = (ParkingPosition.ON_KERB, ParkingPosition.HALF_ON_KERB)
    return [place.polygon for place in world.parking if place.position in on_kerb]


def _closed(shape: BaseGeometry) -> BaseGeometry:
    return shape.buffer(GAP_M / 2, join_style="mitre").buffer(-GAP_M / 2, join_style="mitre")


def _houses(world: World, near: BaseGeometry) -> Iterable[Polygon]:
    return (building.polygon for building in world.buildings if building.polygon.intersects(near))


def _areas(shape: BaseGeometry) -> BaseGeometry:
    """Without slivers narrower than 0.2 m."""
    return shapely.intersection(shape.buffer(-0.1).buffer(0.12, join_style="mitre"), shape)
