"""Streets as the ground plan needs them, with their lanes and the ways of vehicles across junctions."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import shapely

from pavetwin.arrays import Float64Array
from pavetwin.world.model import Direction, Junction, Lane, LaneKind, Segment, Street, World

MAIN_SPEED_MPS: Final = 12.5
"""A street with a limit from here on (45 km/h) is a main street; so is one with more than a lane each way."""


@dataclass(frozen=True)
class StreetPlan:
    """A street with its segments and driving lanes."""

    street: Street
    segments: tuple[Segment, ...]
    ways: tuple[tuple[Lane, ...], ...]
    """The driving lanes of each direction, the one at the kerb first."""

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


PAINTED: Final[Mapping[Direction, Direction]] = {
    Direction.STRAIGHT: Direction.STRAIGHT,
    Direction.LEFT: Direction.LEFT,
    Direction.PARTLY_LEFT: Direction.LEFT,
    Direction.RIGHT: Direction.RIGHT,
    Direction.PARTLY_RIGHT: Direction.RIGHT,
}
"""Which arm of an arrow stands for a connection; nothing is painted for a turnaround."""


@dataclass(frozen=True)
class Approach:
    """A lane that ends at a junction."""

    lane: Lane
    street: StreetPlan
    junction: Junction
    lanes: int
    """Number of lanes that lead the same way."""


@dataclass(frozen=True)
class Path:
    """One way across a junction."""

    approach: Approach
    turn: Direction
    """Straight, left or right."""
    line: Float64Array
    """(n, 2), world frame."""


def paths_of(world: World, streets: tuple[StreetPlan, ...]) -> tuple[Path, ...]:
    """The ways across junctions from the driving lanes of streets, without turnarounds."""
    approaches = {approach.lane.id: approach for approach in _approaches(world, streets)}
    return tuple(
        Path(approaches[connection.from_lane], turn, shapely.get_coordinates(connection.centre_line))
        for connection in world.connections
        if connection.from_lane in approaches and (turn := PAINTED.get(connection.direction))
    )


def _approaches(world: World, streets: tuple[StreetPlan, ...]) -> Iterator[Approach]:
    for street in streets:
        for way in street.ways:
            junction = world.junction(street.street.end_of(way[0].edge))
            if junction is not None:
                for lane in way:
                    yield Approach(lane, street, junction, len(way))
