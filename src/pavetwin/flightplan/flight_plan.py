"""Flight plans: waypoints in WGS 84, one flight per set of batteries, and flights cut into parts for small files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.conditions import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.world.georeference import ELLIPSOID

STRAIGHT_DOWN_DEG: Final = -90.0
"""Pitch of the gimbal: missions look straight down."""


LEAST_LEG_M: Final = 0.5
"""Shorter legs are left out: flight controllers refuse or skip waypoints that are closer together."""


class Trigger(StrEnum):
    """Release of the camera on photographed legs."""

    DISTANCE = "distance"
    TIME = "time"


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A corner of the path, with the settings of the leg that begins there."""

    longitude: float
    latitude: float
    """WGS 84, degrees."""
    height_m: float
    """Above the take-off point."""
    speed_mps: float
    """Over the ground, on the leg that begins here."""
    photographs: bool
    """True if the leg that begins here is photographed."""
    corner_m: float
    """Distance from the waypoint at which the turn begins; 0 if the aircraft stops."""
    segment: str | None
    """Segment that the leg inspects."""


@dataclass(frozen=True)
class PlannedFlight:
    """A flight with one set of batteries, from above the take-off point and back to it."""

    waypoints: tuple[Waypoint, ...]

    @property
    def home(self) -> Waypoint:
        """Above the take-off point."""
        return self.waypoints[0]

    @cached_property
    def lonlat(self) -> Float64Array:
        """(n, 2) longitude and latitude of the waypoints, degrees."""
        return np.array([(each.longitude, each.latitude) for each in self.waypoints])

    @cached_property
    def _legs(self) -> tuple[Float64Array, Float64Array]:
        begins, ends = self.lonlat[:-1], self.lonlat[1:]
        azimuths, _, lengths = ELLIPSOID.inv(*begins.T, *ends.T)
        return np.asarray(azimuths, dtype=np.float64), np.asarray(lengths, dtype=np.float64)

    @property
    def headings_deg(self) -> Float64Array:
        """(n,) heading of the leg that begins at each waypoint, clockwise from true north; the last repeats."""
        azimuths = self._legs[0] % 360.0
        return np.append(azimuths, azimuths[-1:])

    @property
    def lengths_m(self) -> Float64Array:
        """(n - 1,) length of each leg."""
        return self._legs[1]

    @property
    def distance_m(self) -> float:
        """Length over the ground."""
        return float(self.lengths_m.sum())

    @property
    def duration_s(self) -> float:
        """Duration of the legs at their speeds, without climb, descent and braking."""
        return float(sum(m / each.speed_mps for m, each in zip(self.lengths_m, self.waypoints[:-1], strict=True)))


WayHome = Callable[[Waypoint, Waypoint], Sequence[tuple[float, float]]]
"""Function that returns the corners (longitude, latitude) of the way from a waypoint to the one above the take-off
point, at the height of both, with or without the ends."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """All flights of a mission."""

    name: str
    aircraft: str | None
    """Aircraft profile of the mission."""
    flights: tuple[PlannedFlight, ...]
    interval_s: float
    """Time between photographs, if time releases the camera."""
    spacing_m: float
    """Distance between photographs, if distance releases it."""
    trigger: Trigger = Trigger.DISTANCE
    remarks: Sequence[str] = ()
    """Sentences on parts of the mission that the plan leaves out."""
    flown_at: datetime = field(default_factory=lambda: Conditions().utc(0.0))
    """Start of the mission by its conditions."""
    way_home: WayHome | None = None
    """Ways of parts of a flight; straight if None."""


def parts_of(plan: FlightPlan, flight: PlannedFlight, most: int | None) -> Sequence[PlannedFlight]:
    """Cut a flight into parts of at most `most` waypoints; a shorter flight, or any with `most` None, stays whole.

    Every leg of the flight is in one part. Before its first leg and after its last a part follows the plan's way
    between the base and that place, without photographs.

    Raises:
        PaveTwinError: a way has so many corners that no leg of the flight fits into the file.
    """
    waypoints = flight.waypoints
    if most is None or len(waypoints) <= most:
        return [flight]
    parts, begin, last = list[PlannedFlight](), 0, len(waypoints) - 1
    while begin < last:
        out = _way_home(plan, flight, begin)[::-1] if begin else []
        end = min(last, begin + most - len(out) - 1)
        while end > begin and end < last and len(out) + end - begin + 1 + len(_way_home(plan, flight, end)) > most:
            end -= 1
        if end <= begin:
            raise PaveTwinError(
                f"The way from the base to waypoint {begin + 1} has too many corners for a file of {most} waypoints; "
                "choose another format, or inspect fewer segments at once."
            )
        parts.append(PlannedFlight((*out, *_legs(flight, begin, end), *_way_home(plan, flight, end))))
        begin = end
    return parts


def _legs(flight: PlannedFlight, begin: int, end: int) -> list[Waypoint]:
    """The waypoints between two numbers; the aircraft stops at both ends."""
    legs = list(flight.waypoints[begin : end + 1])
    if begin:
        legs[0] = replace(legs[0], corner_m=0.0)
    if end < len(flight.waypoints) - 1:
        legs[-1] = _in_transit(legs[-1], flight)
    return legs


def _way_home(plan: FlightPlan, flight: PlannedFlight, number: int) -> list[Waypoint]:
    """Waypoints from one of the flight to the base; none after its last."""
    if number == len(flight.waypoints) - 1:
        return []
    here, home = flight.waypoints[number], flight.home
    transit = _in_transit(here, flight)
    corners = [] if plan.way_home is None else plan.way_home(here, home)
    points = [replace(transit, longitude=longitude, latitude=latitude) for longitude, latitude in corners]
    kept = [here]
    for each in points:
        if min(_apart_m(kept[-1], each), _apart_m(each, home)) >= LEAST_LEG_M:
            kept.append(each)
    at_home = replace(transit, longitude=home.longitude, latitude=home.latitude)
    return [*kept[1:], at_home]


def _in_transit(waypoint: Waypoint, flight: PlannedFlight) -> Waypoint:
    return replace(waypoint, photographs=False, speed_mps=flight.home.speed_mps, corner_m=0.0, segment=None)


def _apart_m(one: Waypoint, other: Waypoint) -> float:
    return float(ELLIPSOID.inv(one.longitude, one.latitude, other.longitude, other.latitude)[2])
