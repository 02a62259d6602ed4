"""Levels of service that a study's worlds cannot reach, and the nearest that are flown in their place."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.plan import cells_of, traffic_area_m
from pavetwin.mission.inputs import OnProgress
from pavetwin.plugins import load_plugins
from pavetwin.reports.words import listed
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.demand_search import within_reach
from pavetwin.world.model import World


def with_levels_in_reach(
    design: Design, worlds: Sequence[World], tell: OnProgress, on_notice: Callable[[str], None]
) -> Design:
    """The design with the nearest levels for what its worlds cannot reach, where its `or_nearest` allows it.

    Args:
        on_notice: told which levels are replaced in which world.
    """
    if not design.or_nearest:
        return design
    of_area = _records_areas(design)
    entries = []
    for entry, world in zip(design.worlds, worlds, strict=True):
        nearest = {} if entry.traffics else _nearest(design.densities, world, tell, of_area=of_area)
        if nearest:
            on_notice(replaced_sentence(world.name, nearest))
        entries.append(entry.model_copy(update={"nearest": nearest}))
    return design.model_copy(update={"worlds": tuple(entries)})


def replaced_sentence(world: str, nearest: Mapping[str, str]) -> str:
    """Which levels are flown in place of which in a world."""
    levels = [(density_named(name).level, density_named(other).level) for name, other in nearest.items()]
    what, are = ("Level", "is") if len(levels) == 1 else ("Levels", "are")
    missed = listed([f"{level}" for level, _ in levels])
    flown = listed([f"{other} for {level}" for level, other in levels])
    return f"{what} of service {missed} {are} out of reach in '{world}'; the nearest {are} flown: {flown}."


def _records_areas(design: Design) -> bool:
    """Whether traffic is recorded around what is inspected; False where the design is refused later."""
    with suppress(PaveTwinError):
        load_plugins(design.plugins)
        return traffic_area_m(design, cells_of(design)) is not None
    return False


def _nearest(densities: Sequence[str], world: World, tell: OnProgress, *, of_area: bool) -> dict[str, str]:
    """Levels that the world cannot reach → the nearest that it can. What fails otherwise fails in its missions."""
    found = {}

    def search(name: str, _share: float) -> None:
        tell(0.0, f"Finding the demand of {name} in {world.name}")

    for name in densities:
        with suppress(PaveTwinError):
            asked = density_named(name)
            other = within_reach(world, asked, partial(search, name), of_area=of_area)
            if other != asked:
                found[name] = other.name
    return found
