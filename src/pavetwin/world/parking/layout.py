"""Places along a kerb: how many fit into a free interval, where they lie across the street, and their rectangles."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from shapely import Point

from pavetwin.world.parking.kerbs import Kerb, KerbInterval
from pavetwin.world.parking.model import ParkingOrientation, ParkingPosition
from pavetwin.world.parking.rule import ParkingRule, PlaceSize

CAPACITY_SPACING = (0.8, 1.5)
"""Spacings of places, as shares of the rule's, at which a capacity on the map is taken as it is."""


@dataclass(frozen=True, slots=True)
class Slot:
    """One place along a kerb before anything is known about its surroundings."""

    station_m: float
    """Of its centre."""
    centre: Point
    yaw_rad: float
    length_m: float
    width_m: float


def depth_m(size: PlaceSize) -> float:
    """How far a place reaches across the street."""
    angle = math.radians(size.angle_deg)
    return size.length_m * math.sin(angle) + size.width_m * math.cos(angle)


def lane_depth_m(position: ParkingPosition, depth: float) -> float:
    """How much of a place's depth lies on the carriageway, where it takes a parking lane; 0 beside it."""
    match position:
        case ParkingPosition.LANE:
            return depth
        case ParkingPosition.HALF_ON_KERB:
            return depth / 2
        case _:
            return 0.0


def slots_in(
    kerb: Kerb,
    interval: KerbInterval,
    orientation: ParkingOrientation,
    inner_m: float,
    rule: ParkingRule,
    spacing_m: float | None = None,
) -> Iterator[Slot]:
    """As many places as fit into an interval, in the middle of it.

    Args:
        inner_m: where the places begin, outwards from the kerb; below 0 on the carriageway.
        spacing_m: along the kerb, where it is not the rule's.
    """
    size = rule.places[orientation]
    spacing = spacing_m or size.spacing_m
    angle = math.radians(size.angle_deg)
    extent = max(spacing, size.length_m * math.cos(angle) + size.width_m * math.sin(angle))
    room = interval[1] - interval[0]
    count = math.floor((room - extent) / spacing + 1 + 1e-9) if room >= extent else 0
    first = interval[0] + (room - (count - 1) * spacing) / 2
    middle = inner_m + depth_m(size) / 2
    for index in range(count):
        station = first + index * spacing
        foot, (dx, dy) = kerb.at(station)
        out = -dy * kerb.outward, dx * kerb.outward
        yield Slot(
            station,
            Point(foot.x + middle * out[0], foot.y + middle * out[1]),
            math.remainder(math.atan2(dy, dx) + kerb.outward * angle, math.tau),
            min(size.length_m, spacing) if orientation is ParkingOrientation.PARALLEL else size.length_m,
            size.width_m,
        )


def spacing_for(capacity: int | None, free_m: float, size: PlaceSize) -> float | None:
    """The spacing that gives the mapped capacity in what is free; None where it would be unlikely."""
    if not capacity:
        return None
    spacing = free_m / capacity
    low, high = CAPACITY_SPACING
    return spacing if low * size.spacing_m <= spacing <= high * size.spacing_m else None
