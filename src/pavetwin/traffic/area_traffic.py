"""The trips of a town's vehicles, and the traffic that they make on some of its streets.

Where a town's vehicles are is decided by their trips and by the queues that form on the way. An area that is simulated
without its town has the same traffic if as many vehicles are there at any time, and if they come from, go to and leave
into the same streets: the trips are cut to the area, as SUMO's `cutRoutes.py` does with routes.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Self

import numpy as np

SLOWEST_MPS: Final = 0.5
"""Behind an area no street is slower: a vehicle that stood there would close the area."""


@dataclass(frozen=True, slots=True)
class Trip:
    """One vehicle's, during an observation."""

    kind: str
    """SUMO's vehicle type."""
    edges: tuple[str, ...]
    """All edges of its route."""
    entered_s: tuple[float, ...]
    """(edges,) when it entered each; −inf before the observation, +inf not within it."""
    left_s: float
    """When it arrived, or the end of the observation."""


@dataclass(frozen=True, slots=True)
class CutTrip:
    """The part of a trip that leads through an area, from the edge before it to the edge behind it."""

    kind: str
    edges: tuple[str, ...]
    entered_s: tuple[float, ...]
    """(edges + 1,) when each edge was entered, and the last one left; within the observation."""
    departs: bool
    """Whether the trip began here, and not on another street."""
    is_new: bool
    """Whether it came here during the observation, and was not here before."""


@dataclass(frozen=True)
class AreaTraffic:
    """The vehicles on some streets of a town."""

    trips: tuple[CutTrip, ...]
    present: tuple[int, ...]
    """How many were there in each second."""
    speed_mps: Mapping[str, float]
    """On the edges behind the area: distance over time, the wait at their ends included."""

    @property
    def vehicles(self) -> float:
        """How many there are at a time."""
        return float(np.mean(self.present)) if self.present else 0.0

    @classmethod
    def of(cls, trips: Sequence[Trip], area: Set[str], duration_s: float, length_m: Mapping[str, float]) -> Self:
        """
        Args:
            trips: of all vehicles of the town.
            area: the edges of the streets.
            duration_s: of the observation.
            length_m: of all edges.
        """
        cut = tuple(part for trip in trips for part in _cut(trip, area, duration_s))
        seconds = np.arange(int(duration_s))
        began, ended = (np.sort([part.entered_s[end] for part in cut]) for end in (0, -1))
        present = np.searchsorted(began, seconds, "right") - np.searchsorted(ended, seconds, "right")
        behind = {part.edges[-1] for part in cut}.difference(area)
        return cls(cut, tuple(present.tolist()), _speeds(trips, behind, duration_s, length_m))


def _cut(trip: Trip, area: Set[str], duration_s: float) -> list[CutTrip]:
    inside = [False, *(edge in area for edge in trip.edges), False]
    borders = [at for at, (here, there) in enumerate(pairwise(inside)) if here != there]
    until_s = min(trip.left_s, duration_s)
    parts = []
    for begin, end in zip(borders[::2], borders[1::2], strict=True):
        first, last = max(0, begin - 1), min(len(trip.edges), end + 1)
        times = np.clip([*trip.entered_s[first:], trip.left_s][: last - first + 1], 0.0, until_s)
        if times[-1] > times[0]:
            is_new = trip.entered_s[first] > 0.0
            parts.append(CutTrip(trip.kind, trip.edges[first:last], tuple(times.tolist()), first == 0, is_new))
    return parts


def _speeds(
    trips: Sequence[Trip], edges: Set[str], duration_s: float, length_m: Mapping[str, float]
) -> dict[str, float]:
    """Of edges that someone drove on; those who were on one when the observation began or ended count their time."""
    driven_m, taken_s = dict.fromkeys(edges, 0.0), dict.fromkeys(edges, 0.0)
    for trip in trips:
        until_s = min(trip.left_s, duration_s)
        for edge, entered_s, left_s in zip(trip.edges, trip.entered_s, (*trip.entered_s[1:], trip.left_s), strict=True):
            if edge in edges and entered_s < until_s and left_s > 0.0:
                taken_s[edge] += min(left_s, until_s) - max(entered_s, 0.0)
                driven_m[edge] += length_m[edge] if entered_s >= 0.0 and left_s <= until_s else 0.0
    return {edge: max(SLOWEST_MPS, driven_m[edge] / taken_s[edge]) for edge in sorted(edges) if taken_s[edge] > 0.0}
