"""Whether a full set of batteries brings the UAV to its segments and back, known before it takes off."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, cos, hypot, sin

import numpy as np

from pavetwin._core import Battery, FlightSettings, Limits
from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment, flight_settings, window_m
from pavetwin.navigation.patterns import passes
from pavetwin.uav import aircraft_of


@dataclass(frozen=True, slots=True)
class WayOut:
    """The way to the point of a segment that takes most energy, and back, with one set of batteries."""

    segment: int
    """Its index."""
    distance_m: float
    """One way, along the NavMesh."""
    needed: float
    """Share of the usable energy that climbing, flying out and back and landing take, at least: without turns,
    inspection and waiting."""


def ways_out(environment: MissionEnvironment, settings: MissionSettings, targets: Sequence[int]) -> Iterator[WayOut]:
    """For each segment the way to the point of its passes that takes most energy to fly out to and back, as the
    aircraft flies: along the NavMesh, each leg in its wind. Every point of a pass is reached by a flight that begins at
    the base with full batteries and ends there."""
    flight = flight_settings(settings)
    start = environment.mesh.nearest(environment.world.base.x, environment.world.base.y)
    across_m = window_m(settings)[0]
    for target in targets:
        lines = passes(environment.world.segments[target], across_m, settings.pattern)
        points = np.unique(np.concatenate(lines), axis=0).tolist()
        ways = [environment.mesh.path(start, environment.mesh.nearest(*point)) for point in points]
        needed = [_there_and_back(way, flight) for way in ways]
        most = int(np.argmax(needed))
        yield WayOut(target, _length_m(ways[most]), needed[most] + _up_and_down(flight))


def check_reach(environment: MissionEnvironment, settings: MissionSettings, targets: Sequence[int]) -> None:
    """Refuse what one set of batteries cannot fly at all.

    Raises:
        PaveTwinError: it does not bring the UAV to a segment and back; the message says what would help.
    """
    usable = 1.0 - settings.energy.reserve
    beyond = [way for way in ways_out(environment, settings, targets) if way.needed > usable]
    if not beyond:
        return
    farthest = max(beyond, key=lambda way: way.needed)
    segment = environment.world.segments[farthest.segment]
    profile, wind_mps = aircraft_of(settings), settings.conditions.wind_mps
    who = f"a {profile.title}" if profile else "this UAV"
    several = f"One battery is too small for {len(beyond)} of {len(targets)} segments, the farthest of them"
    what = several if len(beyond) > 1 else "One battery is too small for"
    wind = f" in a wind of {wind_mps:g} m/s" if wind_mps else ""
    help_wind = "wait for less wind, " if wind_mps else ""
    raise PaveTwinError(
        f"{what} '{segment.id}': {farthest.distance_m:.0f} m out and as far back at {settings.altitude_m:g} m{wind} "
        f"take {who} at least {100 * farthest.needed:.0f} % of its usable energy, and a flight may use "
        f"{100 * usable:.0f} %. Take off nearer to it (`base`), {help_wind}leave it out, fly another "
        "`aircraft` or with more energy (energy.capacity_wh, energy.reserve)."
    )


def _there_and_back(way: Float64Array, flight: FlightSettings) -> float:
    """Share of the batteries that flying along a way and back takes."""
    return sum(_flown(line, flight.transit, flight.battery) for line in (way, way[::-1]))


def _flown(way: Float64Array, limits: Limits, battery: Battery) -> float:
    """Share of the batteries that flying along a way takes, at the speeds that the wind leaves."""
    total = 0.0
    for (x0, y0), (x1, y1) in pairwise(way.tolist()):
        length_m, yaw = hypot(x1 - x0, y1 - y0), atan2(y1 - y0, x1 - x0)
        speed = limits.speed_towards(yaw)
        velocity = (speed * cos(yaw), speed * sin(yaw))
        total += battery.drained(velocity, seconds=length_m / speed)
    return total


def _up_and_down(flight: FlightSettings) -> float:
    """Share of the batteries that the climb to the altitude and the landing take."""
    seconds = flight.altitude_m / flight.climb_speed_mps
    hover = (0.0, 0.0)
    climb = flight.battery.drained(hover, climb_mps=flight.climb_speed_mps, seconds=seconds)
    return climb + flight.battery.drained(hover, seconds=seconds)


def _length_m(way: Float64Array) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())
