"""Streets as the ground plan needs them: each with its segments and driving lanes."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np
from shapely import LineString

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Lane, LaneKind, Segment, Street, World

MAIN_SPEED_MPS: Final = 12.5
"""A street with a limit from here on (45 km/h) is a main street; so is one with more than a lane each way."""


@dataclass(frozen=True)
class StreetPlan:
    """A street with its segments and driving lanes."""

    street: Street
    segments: tuple[Segment, ...]
    ways: tuple[tuple[Lane, ...], ...]
    """The driving lanes of each direction, the one beside the kerb first."""

    @property
    def key(self) -> str:
        return self.street.id

    @property
    def name(self) -> str:
        return self.street.name

    @property
    def lanes(self) -> tuple[Lane, ...]:
        return tuple(lane for way in self.ways for lane in way)

    @property
    def main(self) -> bool:
        fast = max((lane.speed_limit_mps for lane in self.lanes), default=0.0) >= MAIN_SPEED_MPS
        return fast or max((len(way) for way in self.ways), default=0) > 1


def streets_of(world: World) -> tuple[StreetPlan, ...]:
    """The streets of a world, in its order."""
    segments: dict[tuple[str, ...], list[Segment]] = defaultdict(list)
    for segment in world.segments:
        segments[segment.edges].append(segment)
    ways = {
        street.id: tuple(world.lanes_on(edge, LaneKind.DRIVING) for edge in street.edges) for street in world.streets
    }
    return tuple(
        StreetPlan(street, tuple(segments[street.edges]), tuple(way for way in ways[street.id] if way))
        for street in world.streets
    )


def ways_along(coords: Float64Array) -> Float64Array:
    """(n,) way along a line to each of its points (n, 2)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(coords, axis=0).T))])


def direction(line: LineString, station_m: float, over_m: float = 1.0) -> tuple[float, float]:
    """Unit direction (dx, dy) of a line at a station."""
    low = max(0.0, min(station_m - over_m / 2, line.length - over_m))
    a, b = line.interpolate(low), line.interpolate(min(line.length, low + over_m))
    length = float(np.hypot(b.x - a.x, b.y - a.y)) or 1.0
    return (b.x - a.x) / length, (b.y - a.y) / length
