"""Extent of maps of a world, and their attribution; imports no drawing library."""

from typing import Final

import shapely

from pavetwin.world.ground import Bounds
from pavetwin.world.model import World
from pavetwin.world.store import attribution, load_record

MARGIN_M: Final = 12.0


def world_bounds(world: World) -> Bounds:
    """Extent of a map of the whole world: its streets and buildings and a margin, in metres."""
    items = [segment.polygon for segment in world.segments] + [building.polygon for building in world.buildings]
    west, south, east, north = (float(value) for value in shapely.total_bounds(items))
    return west - MARGIN_M, south - MARGIN_M, east + MARGIN_M, north + MARGIN_M


def credit(world: World) -> str | None:
    """The attribution required under a map of this world."""
    return attribution(load_record(world.folder).source) if world.folder is not None else None
