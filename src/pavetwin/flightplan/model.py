"""A flight plan: waypoints in WGS 84, a flight for each set of batteries."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from functools import cached_property
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.conditions import Conditions
from pavetwin.world.georeference import ELLIPSOID

STRAIGHT_DOWN_DEG: Final = -90.0
"""Pitch of the gimbal: missions look straight down."""


LEAST_LEG_M: Final = 0.5
"""Shorter legs are left out: flight controllers refuse or skip waypoints that are closer together."""


class Trigger(StrEnum):
    """What releases the camera on the legs that are photographed."""

    DISTANCE = "distance"
    TIME = "time"


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A corner of the path, and how the leg from it to the next one is flown."""

    longitude: float
    latitude: float
    """WGS 84, degrees."""
    height_m: float
    """Above the take-off point."""
    speed_mps: float
    """Over the ground, on the leg that begins here."""
    photographs: bool
    """Whether the leg that begins here is photographed."""
    corner_m: float
    """From the waypoint at which the turn begins; 0 where the aircraft stops."""
    segment: str | None
    """That the leg inspects."""


@dataclass(frozen=True)
class PlannedFlight:
    """What is flown with one set of batteries: from above the take-off point and back to it."""

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
        """(n,) clockwise from true north along the leg that begins at each waypoint; at the last as before it."""
        azimuths = self._legs[0] % 360.0
        return np.append(azimuths, azimuths[-1:])

    @property
    def lengths_m(self) -> Float64Array:
        """(n - 1,) of the legs."""
        return self._legs[1]

    @property
    def distance_m(self) -> float:
        """Over the ground."""
        return float(self.lengths_m.sum())

    @property
    def duration_s(self) -> float:
        """Of the legs at their speeds: without climb, descent and slowing down."""
        return float(sum(m / each.speed_mps for m, each in zip(self.lengths_m, self.waypoints[:-1], strict=True)))


WayHome = Callable[[Waypoint, Waypoint], Sequence[tuple[float, float]]]
"""Corners (longitude, latitude) of the way from the first waypoint to the second, above the take-off point, at the
height of both; with or without the ends."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """All flights of a mission."""

    name: str
    aircraft: str | None
    """The profile that the mission flew with."""
    flights: tuple[PlannedFlight, ...]
    interval_s: float
    """Between photographs, where time releases the camera."""
    spacing_m: float
    """Between photographs, where distance releases it."""
    trigger: Trigger = Trigger.DISTANCE
    remarks: Sequence[str] = ()
    """What of the mission is not in the plan, as sentences."""
    flown_at: datetime = field(default_factory=lambda: Conditions().utc(0.0))
    """When the mission begins, by its conditions."""
    way_home: WayHome | None = None
    """For parts of a flight; straight ways where it is None."""
