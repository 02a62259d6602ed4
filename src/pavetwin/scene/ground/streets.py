"""Streets as their users see them: lanes with their edges, which arms meet at a junction, what class each is of."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

import numpy as np
from shapely import LineString

from pavetwin.world.model import Lane, LaneKind, Segment, World

MAIN_SPEED_MPS: Final = 12.5
"""A street with a limit from here on (45 km/h) is a main street; so is one with more than a lane each way."""


@dataclass(frozen=True)
class Street:
    """All segments on the same edges, and their driving lanes."""

    key: str
    """Its edges' names: stable while streets elsewhere come and go."""
    name: str
    segments: tuple[Segment, ...]
    ways: tuple[tuple[Lane, ...], ...]
    """The driving lanes of each direction, the one beside the kerb first."""
    left_hand: bool

    @property
    def lanes(self) -> tuple[Lane, ...]:
        return tuple(lane for way in self.ways for lane in way)

    @property
    def main(self) -> bool:
        fast = max((lane.speed_limit_mps for lane in self.lanes), default=0.0) >= MAIN_SPEED_MPS
        return fast or max((len(way) for way in self.ways), default=0) > 1


def streets_of(world: World) -> tuple[Street, ...]:
    """The streets of a world in the order of their first segments."""
    lanes: dict[str, list[Lane]] = defaultdict(list)
    for lane in world.lanes_of(LaneKind.DRIVING):
        lanes[lane.edge].append(lane)
    segments: dict[tuple[str, ...], list[Segment]] = defaultdict(list)
    for segment in world.segments:
        segments[segment.edges].append(segment)
    left_hand = _keeps_left(world, lanes)
    return tuple(
        Street(
            key=" ".join(edges),
            name=pieces[0].street,
            segments=tuple(pieces),
            ways=tuple(tuple(sorted(lanes[edge], key=_number)) for edge in edges if lanes[edge]),
            left_hand=left_hand,
        )
        for edges, pieces in segments.items()
    )


def _number(lane: Lane) -> int:
    number = lane.id.rpartition("_")[2]
    return int(number) if number.isdigit() else 0


def _keeps_left(world: World, lanes: dict[str, list[Lane]]) -> bool:
    """Whether traffic drives on the left: where the lanes of two-way streets lie about their centre lines."""
    votes = 0.0
    for segment in world.segments:
        if len(segment.edges) < 2:
            continue
        middle = segment.centre_line.interpolate(0.5, normalized=True)
        for lane in lanes[segment.edges[0]]:
            station = lane.centre_line.project(middle)
            at = lane.centre_line.interpolate(station)
            dx, dy = direction(lane.centre_line, station)
            votes += dx * (at.y - middle.y) - dy * (at.x - middle.x)
    return votes > 0


def direction(line: LineString, station_m: float, over_m: float = 1.0) -> tuple[float, float]:
    """Unit direction (dx, dy) of a line at a station."""
    low = max(0.0, min(station_m - over_m / 2, line.length - over_m))
    a, b = line.interpolate(low), line.interpolate(min(line.length, low + over_m))
    length = float(np.hypot(b.x - a.x, b.y - a.y)) or 1.0
    return (b.x - a.x) / length, (b.y - a.y) / length
