"""Where vehicles cross junctions, and which of it is painted: from the connections of a world."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import shapely

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.layout.streets import StreetPlan
from pavetwin.world.model import Direction, Junction, Lane, World

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
    """Of its direction."""


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
