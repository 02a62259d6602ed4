"""The lines between parking places on the carriageway and in bays: at each end of a place, from its kerb to the driven
lane."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from shapely import LineString, Point

from pavetwin.arrays import Float64Array
from pavetwin.world.model import World
from pavetwin.world.parking import ParkingOrientation, ParkingPlace, ParkingPosition

SHARED_M: Final = 0.3
"""Lines of neighbouring places that are nearer to each other are one [m]."""

MARGIN_M: Final = 0.1
"""The lines end this far before the driven lane [m]."""

GUTTER_FREE_M: Final = 0.45
"""And this far before the kerb, where gutters and grates are [m]."""


def parking_lines(world: World) -> Iterator[tuple[LineString, ParkingPlace]]:
    """Each line with a place that it ends, in the order of the world's places; metres, world frame."""
    drawn: dict[str, list[tuple[float, float]]] = {}
    for place in world.parking:
        if place.position not in (ParkingPosition.LANE, ParkingPosition.STREET_SIDE):
            continue
        taken = drawn.setdefault(place.street, [])
        middle_line = world.segment(place.segment).centre_line
        for ends in _sides(place):
            kerb, inner = sorted(ends, key=lambda end: -middle_line.distance(Point(end)))
            towards = (inner - kerb) / np.hypot(*(inner - kerb))
            x, y = (kerb + inner) / 2
            if all((x - other[0]) ** 2 + (y - other[1]) ** 2 > SHARED_M**2 for other in taken):
                taken.append((x, y))
                yield LineString([kerb + GUTTER_FREE_M * towards, inner - MARGIN_M * towards]), place


def _sides(place: ParkingPlace) -> Iterator[tuple[Float64Array, Float64Array]]:
    """The ends of the two sides of a place that run across the street."""
    ahead = np.array([np.cos(place.yaw_rad), np.sin(place.yaw_rad)])
    left = np.array([-ahead[1], ahead[0]])
    parallel = place.orientation is ParkingOrientation.PARALLEL
    across, along = (left, ahead) if parallel else (ahead, left)
    reach, apart = (place.width_m, place.length_m) if parallel else (place.length_m, place.width_m)
    centre = np.array([place.centre.x, place.centre.y])
    for side in (-0.5, 0.5):
        middle = centre + side * apart * along
        yield middle - reach / 2 * across, middle + reach / 2 * across
