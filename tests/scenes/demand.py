"""Demand that is known before anybody searches: made-up trials, in the cache where a search keeps its own."""

from math import exp
from unittest.mock import patch

from pavetwin.traffic.demand import LevelOfService
from pavetwin.traffic.demand_search import DemandSearch, Trial
from pavetwin.world.model import World

EMPTY_RATIO = 0.72
SCALE_PER_LANE_KM = 11.0
FREE_FLOW_KMH = 45.0


def on_the_curve(search: DemandSearch, *counts: int, empty_ratio: float = EMPTY_RATIO) -> list[Trial]:
    """What trials would give in a network that follows the curve of `demand_search` exactly."""
    trials = []
    search._report(1.0)
    for count in counts:
        density = count / search._inputs.capacity.lanes_km
        ratio = empty_ratio * exp(-0.5 * (density / SCALE_PER_LANE_KM) ** 2)
        trials.append(Trial(round(density, 3), round(ratio, 4), round(density * FREE_FLOW_KMH * ratio, 2), 0.0))
    return trials


def know_demand(world: World, *mixes: str) -> None:
    """Keep the trials of all levels that a town reaches in the world's cache: a search of it simulates nothing then."""
    with patch.object(DemandSearch, "_simulated", on_the_curve):
        for mix in mixes or ("europe",):
            for level in list(LevelOfService)[1:]:
                DemandSearch(world, mix).of_level(level)
