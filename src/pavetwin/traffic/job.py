"""Messages between the simulation's process and its owner: a job, and parts of the recording; and the values in them.

`AreaTraffic` is the traffic of some streets of a town. The places of a town's vehicles depend on their trips and on the
queues on the way. An area that is simulated without its town has the same traffic if as many vehicles are there at any
time, and if they come from, go to and leave into the same streets: the trips are cut to the area, as SUMO's
`cutRoutes.py` does with routes. Imports little, since the simulation's process needs it.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float64Array, UInt32Array

if TYPE_CHECKING:
    from pavetwin.world.model import World


SLOWEST_MPS: Final = 0.5
"""Lowest speed on the streets behind an area: a standing vehicle there would block the area."""


@dataclass(frozen=True, slots=True)
class Trip:
    """Trip of one vehicle during an observation."""

    kind: str
    """SUMO's vehicle type."""
    edges: tuple[str, ...]
    """All edges of its route."""
    entered_s: tuple[float, ...]
    """(edges,) when it entered each; −inf before the observation, +inf not within it."""
    left_s: float
    """Arrival, or the end of the observation."""


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
    """Number of vehicles in each second."""
    speed_mps: Mapping[str, float]
    """Speed on the edges behind the area: distance over time, the wait at their ends included."""

    @property
    def vehicles(self) -> float:
        """Mean number at a time."""
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
    """Speeds on edges in use; vehicles on one at the beginning or end of the observation count their time."""
    driven_m, taken_s = dict.fromkeys(edges, 0.0), dict.fromkeys(edges, 0.0)
    for trip in trips:
        until_s = min(trip.left_s, duration_s)
        for edge, entered_s, left_s in zip(trip.edges, trip.entered_s, (*trip.entered_s[1:], trip.left_s), strict=True):
            if edge in edges and entered_s < until_s and left_s > 0.0:
                taken_s[edge] += min(left_s, until_s) - max(entered_s, 0.0)
                driven_m[edge] += length_m[edge] if entered_s >= 0.0 and left_s <= until_s else 0.0
    return {edge: max(SLOWEST_MPS, driven_m[edge] / taken_s[edge]) for edge in sorted(edges) if taken_s[edge] > 0.0}


SPACING_M: Final = 4.0
"""Between the points of a lane's centre line that stand for it."""

TURNED_M: Final = 12.0
"""A lane in the opposite direction counts as twice this much farther away."""


class SpeedLimits:
    """The speed limit at places of a world, by direction of travel."""

    def __init__(self, places: Float64Array, limits: Float64Array) -> None:
        """
        Args:
            places: (n, 4) as of `_key`.
            limits: (n,) metres per second.
        """
        from scipy.spatial import cKDTree  # takes long to import

        self.places, self.limits = places, limits
        self._tree = cKDTree(places)

    @classmethod
    def of(cls, world: "World") -> Self:
        from pavetwin.world.model import LaneKind

        points, limits = [np.zeros((0, 4))], [np.zeros(0)]
        for lane in world.lanes_of(LaneKind.DRIVING):
            at_m = np.linspace(0.0, lane.length_m, max(2, int(lane.length_m / SPACING_M) + 1))
            line = np.asarray(lane.centre_line.coords)[:, :2]
            along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            xy = np.stack([np.interp(at_m, along_m, line[:, axis]) for axis in (0, 1)], axis=-1)
            ahead = np.gradient(xy, axis=0)
            points.append(_key(xy[:, 0], xy[:, 1], np.arctan2(ahead[:, 1], ahead[:, 0])))
            limits.append(np.full(len(at_m), lane.speed_limit_mps))
        return cls(np.concatenate(points), np.concatenate(limits))

    def __reduce__(self) -> tuple[type[Self], tuple[Float64Array, Float64Array]]:
        return type(self), (self.places, self.limits)

    def __bool__(self) -> bool:
        """Whether the world has lanes."""
        return len(self.limits) > 0

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike, yaw_rad: npt.ArrayLike) -> Float64Array:
        """Metres per second at places (n,) of the world's frame, headed by `yaw_rad` counter-clockwise from east."""
        nearest = self._tree.query(_key(x, y, yaw_rad))[1]
        limits: Float64Array = self.limits[nearest]
        return limits


def _key(x: npt.ArrayLike, y: npt.ArrayLike, yaw_rad: npt.ArrayLike) -> Float64Array:
    """(n, 4) keys; close places and directions have close keys."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    key: Float64Array = np.stack(
        [np.asarray(x, np.float64), np.asarray(y, np.float64), TURNED_M * np.cos(yaw), TURNED_M * np.sin(yaw)], axis=-1
    )
    return key


STEP_S: Final = 0.5
"""SUMO's step and the recording's."""

OUTPUT: Final = "output.txt"
"""File of SUMO's output in a job's folder."""


@dataclass(frozen=True)
class SimulationJob:
    """Inputs of one simulation. Paths are absolute."""

    folder: str
    """Temporary folder of this simulation; its process removes it if the owner was killed."""
    network: str
    lanes_of: Mapping[str, Sequence[str]]
    """The lanes of each directed edge of the world, from the kerb to the middle of the street."""
    additional: str
    routes: list[str]
    """A user's own demand; empty for the closed loop."""
    seed: int
    sumo_seed: int
    warm_up_s: tuple[float, float]
    """The shortest and the longest warm-up."""
    begin_s: float = 0.0
    """SUMO's clock at its first step."""
    vehicles: int = 0
    pedestrians: int = 0
    options: Sequence[str] = ()
    """Options of SUMO that replace those of every recording."""
    vehicle_types: Sequence[tuple[str, float]] = ()
    """SUMO's, of the closed loop's vehicles, with their shares."""
    fastest_goals: bool = True
    """Whether a trip of the closed loop leads to the fastest of several random goals."""
    speed_ratio: float | None = None
    """Speed ratio that is held by changing the number of vehicles; None for a fixed number."""
    speed_limits: SpeedLimits | None = None
    """Needed for that."""
    area: frozenset[str] | None = None
    """The edges that traffic of the closed loop uses; None for all."""
    area_traffic: AreaTraffic | None = None
    """The vehicles of the area, where they are those of its town; None for a closed loop of its own."""
    reads_trips: bool = False
    """Whether the trips of vehicles are read in place of poses."""
    reads_pedestrians: bool = True
    """Whether pedestrians are among the rows; they walk in any case."""


@dataclass(frozen=True, slots=True)
class Body:
    """Agent in SUMO. A user's person may have a vehicle's id."""

    id: str
    is_pedestrian: bool
    kind: str
    length_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive frames. Rows are sorted by (frame, agent)."""

    start_s: float
    """Simulated time of the recording's first frame, in every part."""
    sumo_version: str
    bodies: Sequence[Body]
    """The agents that are new in this part; numbered in this order from the first part on."""
    rows: UInt32Array
    """(frames,) how many each frame has"""
    agent: UInt32Array
    """(rows,)"""
    x: Float64Array
    """(rows,) of a vehicle's front bumper, of a person's centre, metres east"""
    y: Float64Array
    """(rows,) metres north"""
    heading_deg: Float64Array
    """(rows,) clockwise from north"""
    speed_mps: Float64Array
    """(rows,)"""
    removals: Sequence[tuple[int, int]]
    """(step of the recording, number of vehicles that SUMO removed from gridlock)"""
    signals: Mapping[str, Sequence[tuple[int, str]]]
    """Per traffic light, (step of the recording, state of its links) at step 0 and at each change."""
    trips: Sequence[Trip] = ()
    """Trips of all vehicles so far, if the job requests them."""


def yaw_of_heading(heading_deg: npt.ArrayLike) -> Float64Array:
    """Degrees clockwise from north to radians counter-clockwise from east, in −π … π."""
    turned = np.radians(90.0 - np.asarray(heading_deg, dtype=np.float64))
    yaw: Float64Array = np.arctan2(np.sin(turned), np.cos(turned))
    return yaw


def centre_of_front(front: npt.ArrayLike, yaw_rad: npt.ArrayLike, length_m: npt.ArrayLike) -> Float64Array:
    """The centres (..., 2) of bodies whose front bumpers' middles are `front` (..., 2), in metres."""
    yaw, half = np.asarray(yaw_rad, dtype=np.float64), np.asarray(length_m, dtype=np.float64)[..., np.newaxis] / 2
    centre: Float64Array = np.asarray(front, dtype=np.float64) - half * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    return centre
