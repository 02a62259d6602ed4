"""A flight in parts, for programs that hold few waypoints: each part takes off and lands at the base."""

from collections.abc import Sequence
from dataclasses import replace

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan.model import LEAST_LEG_M, FlightPlan, PlannedFlight, Waypoint
from pavetwin.world.georeference import ELLIPSOID


def parts_of(plan: FlightPlan, flight: PlannedFlight, most: int | None) -> Sequence[PlannedFlight]:
    """A flight of a plan in parts of at most so many waypoints; whole where it has no more, or `most` is None.

    Every leg of the flight is in one part. Before its first leg and after its last a part follows the plan's way
    between the base and that place, without photographs.

    Raises:
        PaveTwinError: a way has so many corners that no leg of the flight has room beside it.
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
    """The waypoints from one to another; the aircraft stops at both."""
    legs = list(flight.waypoints[begin : end + 1])
    if begin:
        legs[0] = replace(legs[0], corner_m=0.0)
    if end < len(flight.waypoints) - 1:
        legs[-1] = _in_transit(legs[-1], flight)
    return legs


def _way_home(plan: FlightPlan, flight: PlannedFlight, number: int) -> list[Waypoint]:
    """The waypoints after one of the flight, to the base; none after its last."""
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
