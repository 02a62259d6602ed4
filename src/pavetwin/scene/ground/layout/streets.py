"""Streets as the ground plan needs them: each with its segments and driving lanes."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

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
