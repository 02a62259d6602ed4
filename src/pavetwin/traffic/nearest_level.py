"""The level of service that is recorded where nobody asks for one: the usual, or the nearest that a world can reach."""

from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import Density, density_named, level_density
from pavetwin.traffic.demand_search import DemandSearch, UnreachableError, search_for_areas
from pavetwin.traffic.level_of_service import LevelOfService
from pavetwin.traffic.runner import OnRecorded
from pavetwin.world.model import World

_ORDER: Final = tuple(LevelOfService)


def within_reach(
    world: World, asked: Density, on_search: OnRecorded | None = None, *, of_area: bool = False
) -> Density:
    """`asked`, or where it is a level of service that the world cannot reach, the nearest that it can; of two that are
    as near the worse one.

    Args:
        on_search: told the share done of the search for a level's demand.
        of_area: whether it is recorded on an area of the world.

    Raises:
        PaveTwinError: the world reaches no level of service at all, or SUMO fails.
    """
    if asked.level is None:
        return asked
    refusals: list[PaveTwinError] = []
    search = search_for_areas if of_area else DemandSearch
    for level in nearest_first(asked.level):
        try:
            search(world, asked.mix, on_search).of_level(level)
        except UnreachableError as error:
            refusals.append(error)
            continue
        return asked if level is asked.level else density_named(level_density(level).name, asked.mix)
    raise refusals[0]


def nearest_first(level: LevelOfService) -> list[LevelOfService]:
    """All levels, the nearest to `level` first; of two that are as near the worse one."""
    at = _ORDER.index(level)
    return sorted(_ORDER, key=lambda other: (abs(_ORDER.index(other) - at), _ORDER.index(other) < at))
