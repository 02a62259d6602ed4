"""Which segments a mission inspects, and in which order."""

from collections.abc import Sequence

import numpy as np
import shapely

from pavetwin.errors import PaveTwinError, about
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.seeds import Stream, child
from pavetwin.world.model import World

ORDERS = ("random", "near")


def choose_targets(
    environment: MissionEnvironment,
    *,
    count: int | None = None,
    names: Sequence[str] = (),
    order: str = "random",
    seed: int = 0,
) -> list[int]:
    """Indices of the segments to inspect.

    Args:
        count: how many; all that can be reached when not given.
        names: inspect just these, in this order when `order` is random: ids of segments, or names of streets, which
            stand for all their segments.
        order: `random`, a randomised sequence; or `near`, a short tour from the base.

    Raises:
        PaveTwinError: a segment does not exist or cannot be reached, or the count does not fit.
    """
    if order not in ORDERS:
        raise PaveTwinError(f"`order` {order}: known are {', '.join(ORDERS)}.")
    world = environment.world
    if names:
        named = _named(environment, names)
        return named if order == "random" else short_tour(world, named)
    reachable = [index for index in range(len(world.segments)) if environment.reachable(index)]
    if not reachable:
        raise PaveTwinError(
            f"No segment of '{world.name}' can be reached from the base at {environment.altitude_m:g} m; "
            "choose another altitude, or another `base`."
        )
    if count is not None and count < 1:
        raise PaveTwinError(f"`count` {count}: at least one segment must be inspected.")
    if count is not None and count > len(reachable):
        there_are = (
            f"'{world.name}' has only {len(reachable)}"
            if len(reachable) == len(world.segments)
            else f"only {len(reachable)} of the {len(world.segments)} segments of '{world.name}' can be reached at "
            f"{environment.altitude_m:g} m"
        )
        raise PaveTwinError(f"`count` {count}: {there_are}; `count=None` inspects them all.")
    if order == "near":
        return short_tour(world, reachable)[:count]
    drawn = child(seed, Stream.ORDER).permutation(len(reachable))
    return [reachable[index] for index in drawn[:count]]


def _named(environment: MissionEnvironment, names: Sequence[str]) -> list[int]:
    index = {segment.id: number for number, segment in enumerate(environment.world.segments)}
    chosen = []
    for name in names:
        with about("names"):
            segments = environment.world.segments_named(name)
        for segment in segments:
            number = index[segment.id]
            what = name if name == segment.id else f"{name}, {segment.id}"
            if not environment.reachable(number):
                raise PaveTwinError(
                    f"`names` {what}: no way leads there from the base at {environment.altitude_m:g} m; "
                    "`pavetwin world navmesh` shows where one can fly. Choose another altitude or segment."
                )
            if number in chosen:
                raise PaveTwinError(f"`names` {what}: given more than once; a mission inspects a segment once.")
            chosen.append(number)
    return chosen


def short_tour(world: World, chosen: Sequence[int]) -> list[int]:
    """Always the nearest next, then straightened by 2-opt: a short open tour from the base.

    Args:
        chosen: indices of the segments to inspect.
    """
    middles = [world.segments[index].centre_line.interpolate(0.5, normalized=True) for index in chosen]
    places = np.vstack([[(world.base.x, world.base.y)], shapely.get_coordinates(middles)])
    distance = np.hypot(*np.moveaxis(places[:, None] - places[None], -1, 0))
    tour, left = [0], set(range(1, len(places)))
    while left:
        tour.append(min(left, key=lambda place: (float(distance[tour[-1], place]), place)))
        left.remove(tour[-1])
    return [chosen[place - 1] for place in _two_opt(tour, distance)[1:]]


def _two_opt(tour: list[int], distance: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> list[int]:
    improved = True
    while improved:
        improved = False
        for i in range(1, len(tour) - 1):
            for j in range(i + 1, len(tour)):
                before = distance[tour[i - 1], tour[i]]
                after = distance[tour[i - 1], tour[j]]
                if j + 1 < len(tour):
                    before += distance[tour[j], tour[j + 1]]
                    after += distance[tour[i], tour[j + 1]]
                if after < before - 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1]
                    improved = True
    return tour
