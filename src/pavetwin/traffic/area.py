"""The streets around the targets of a mission, on which its traffic is recorded.

Only traffic on the inspected streets hides the road, but the streets around them determine it: queues that reach back
from the next junctions, and platoons that signals form. A recording of an area holds the streets within a distance of
the targets, and the rest of the town is empty. Why that distance is enough: docs/explanation/traffic.md, "Area".

Targets that lie in one square of a fixed grid share their area, whichever of them a mission inspects, so their
recording is made once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from itertools import count
from math import floor
from typing import Final, Self

import shapely

from pavetwin.world.model import LaneKind, Segment, World

SQUARE_M: Final = 200.0
"""Side of the squares of the grid."""

MOST_SHARE: Final = 0.5
"""Largest share of a town's kilometres of lane: a larger area is the whole town, whose recording all missions share."""

OBSERVED_SHARE: Final = 2.0
"""An area's vehicles are observed on so many times its own kilometres of lane."""

OBSERVED_LEAST_KM: Final = 10.0
"""Least number: those of the demo's town and more."""

GROWN_M: Final = 50.0
"""The streets on which they are observed grow by this distance until they are enough."""


@dataclass(frozen=True, eq=True)
class TrafficArea:
    """Some streets of a world."""

    distance_m: float
    """Distance from the targets."""
    edges: tuple[str, ...]
    """Their directed edges, in the world's order: all of a street or none."""

    @classmethod
    def around(
        cls, world: World, targets: Iterable[str], distance_m: float, *, most_share: float = MOST_SHARE
    ) -> Self | None:
        """The area of a mission; None for the whole town, where the area would hold most of it.

        Args:
            targets: ids of the segments to inspect.
            distance_m: of the streets in the area, from the segments of the squares of the targets.
            most_share: of the kilometres of lane; from it on the area is the whole town.

        Raises:
            PaveTwinError: a segment does not exist.
        """
        squares = {_square(world.segment(name)) for name in targets}
        seeds = [segment.centre_line for segment in world.segments if _square(segment) in squares]
        edges = _edges_near(world, seeds, distance_m)
        area = cls(distance_m, edges)
        return area if area.length_km(world) < most_share * world.length_km(LaneKind.DRIVING) else None

    def surroundings(self, world: World) -> Self | None:
        """The streets around it on which its vehicles are observed; None for those of the whole town, where that is not
        twice as large."""
        least_km = max(OBSERVED_LEAST_KM, OBSERVED_SHARE * self.length_km(world))
        town_km = world.length_km(LaneKind.DRIVING)
        if least_km >= MOST_SHARE * town_km:
            return None
        lines = [lane.centre_line for edge in self.edges for lane in world.lanes_by_edge[edge]]
        for distance_m in count(GROWN_M, GROWN_M):
            around = type(self)(distance_m, _edges_near(world, lines, distance_m))
            if (length_km := around.length_km(world)) >= least_km:
                return around if length_km < MOST_SHARE * town_km else None
        raise AssertionError

    @property
    def name(self) -> str:
        """Name in files."""
        return f"{self.distance_m:g}m-{sha256(' '.join(self.edges).encode()).hexdigest()[:8]}"

    @cached_property
    def _known(self) -> frozenset[str]:
        return frozenset(self.edges)

    def length_km(self, world: World, kind: LaneKind = LaneKind.DRIVING) -> float:
        """Summed length of its lanes of a kind."""
        return sum(lane.length_m for lane in world.lanes_of(kind) if lane.edge in self._known) / 1000

    def misses(self, segments: Iterable[Segment]) -> list[str]:
        """Ids of segments that do not lie in it."""
        return [segment.id for segment in segments if not self._known.issuperset(segment.edges)]


def may_be_observed_in_part(world: World) -> bool:
    """Whether the vehicles of some areas are observed on the streets around them alone."""
    return world.length_km(LaneKind.DRIVING) > OBSERVED_LEAST_KM / MOST_SHARE


def _square(segment: Segment) -> tuple[int, int]:
    middle = segment.centre_line.interpolate(0.5, normalized=True)
    return floor(middle.x / SQUARE_M), floor(middle.y / SQUARE_M)


def _edges_near(world: World, seeds: Sequence[shapely.LineString], distance_m: float) -> tuple[str, ...]:
    """The edges of all streets of which some part is within a distance of lines."""
    lanes = [lane for lane in world.lanes if lane.kind is not LaneKind.PARKING]
    tree = shapely.STRtree([lane.centre_line for lane in lanes])
    near = {lanes[at].edge for at in tree.query(seeds, predicate="dwithin", distance=distance_m)[1].tolist()}
    whole = near.union(*(street.edges for street in world.streets if near.intersection(street.edges)))
    return tuple(edge for edge in world.lanes_by_edge if edge in whole)
