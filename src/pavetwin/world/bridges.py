"""Which parts of streets lie on bridges, from the map's ways."""

from collections.abc import Iterable
from typing import Final

from shapely import LineString, Point

NEAR_M: Final = 6.0
"""A bridge is on a street whose centre line passes its middle and both ends this near: netconvert moves centre lines by
up to half a carriageway."""

SHORTEST_M: Final = 4.0


def bridges_on(centre_line: LineString, bridges: Iterable[LineString]) -> tuple[tuple[float, float], ...]:
    """Stations [m] of a street's centre line between which it lies on a bridge, rounded to centimetres, in order.

    Args:
        bridges: the map's ways that are bridges, in the frame of the centre line; ways longer than the street count as
            far as they follow it.
    """
    found = []
    for bridge in bridges:
        ends = [bridge.project(Point(centre_line.coords[end])) for end in (0, -1)]
        low, high = min(ends), max(ends)
        points = [bridge.interpolate(low + share * (high - low)) for share in (0.05, 0.5, 0.95)]
        if all(centre_line.distance(point) < NEAR_M for point in points):
            first, last = sorted(centre_line.project(bridge.interpolate(station)) for station in (low, high))
            if last - first > SHORTEST_M:
                found.append((round(first, 2), round(last, 2)))
    return tuple(sorted(found))
