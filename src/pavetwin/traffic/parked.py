"""Vehicles that stand in a world's parking places.

They are static: drawn once for a mission from its settings, its date and time and a seed, without SUMO. What stands in
a place depends on the seed and the place alone, never on other places. A place that is taken at one occupancy is taken,
by the same vehicle, at every higher one.
"""

import math
from dataclasses import dataclass, fields
from typing import Final, Self

import numpy as np

from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.config.conditions import Conditions
from pavetwin.config.parking import ParkingSettings
from pavetwin.seeds import Stream, child
from pavetwin.traffic.kinds import VEHICLES, Kind
from pavetwin.traffic.occupancy import occupancy, surroundings_of
from pavetwin.world.model import World
from pavetwin.world.parking.hours import is_within
from pavetwin.world.parking.model import ParkingOrientation, ParkingPlace

SPREAD_ALONG_M: Final = 0.25
SPREAD_ACROSS_M: Final = 0.10
SPREAD_YAW_RAD: Final = math.radians(1.5)
"""Standard deviations of how a vehicle stands in its place; each is cut at two of them. Ours."""

BACKWARDS: Final = 0.2
"""Share of the vehicles in diagonal and perpendicular places that have been reversed into them. Ours."""

PARKING_CLASSES: Final = frozenset({"passenger", "delivery", "motorcycle"})
"""SUMO vehicle classes that park at the roadside, where they fit."""


@dataclass(frozen=True, eq=False)
class ParkedVehicles:
    """Parked vehicles, in the order of the world's places. All arrays (vehicles,)."""

    place: IndexArray
    """Index in `World.parking`."""
    kind: tuple[str, ...]
    """Of `kinds.KINDS`."""
    x: Float64Array
    """Centre of the body on the ground, metres east."""
    y: Float64Array
    """Metres north."""
    yaw_rad: Float64Array
    """Where its front is, anticlockwise from east, −π … π."""
    length_m: Float64Array
    width_m: Float64Array
    height_m: Float64Array

    def __post_init__(self) -> None:
        for each in fields(self):
            if len(getattr(self, each.name)) != len(self.place):
                raise ValueError(f"ParkedVehicles.{each.name} must have {len(self.place)} entries")

    def __len__(self) -> int:
        return len(self.place)

    @classmethod
    def empty(cls) -> Self:
        """No vehicle."""
        none = np.zeros(0)
        return cls(np.zeros(0, dtype=np.intp), (), none, none, none, none, none, none)


def parked_vehicles(world: World, settings: ParkingSettings, conditions: Conditions, seed: int) -> ParkedVehicles:
    """The vehicles that are parked in a world at the date and time of the conditions.

    Each stands within its place, so that none overlaps another and none reaches beyond its neighbours.
    """
    if not settings.enabled or not world.parking:
        return ParkedVehicles.empty()
    kind_of_street = {street.id: street.kind for street in world.streets}
    shares: dict[str, float] = {}
    stood: list[tuple[int, Kind, float, float, float]] = []
    for index, place in enumerate(world.parking):
        street_kind = kind_of_street.get(place.street, "")
        if street_kind not in shares:
            by_curve = settings.occupancy is None
            shares[street_kind] = (
                occupancy(surroundings_of(street_kind), conditions) if by_curve else float(settings.occupancy or 0.0)
            )
        if place.closed and is_within(place.closed, conditions.date, conditions.time):
            continue
        rng = child(seed, Stream.PARKING, place.key)
        if rng.random() < shares[street_kind] and (vehicle := _vehicle_in(place, rng)) is not None:
            stood.append((index, *vehicle))
    if not stood:
        return ParkedVehicles.empty()
    place_index, kinds, x, y, yaw = zip(*stood, strict=True)
    return ParkedVehicles(
        np.array(place_index, dtype=np.intp),
        tuple(kind.name for kind in kinds),
        np.array(x),
        np.array(y),
        np.array(yaw),
        *(np.array([getattr(kind, name) for kind in kinds]) for name in ("length_m", "width_m", "height_m")),
    )


def _vehicle_in(place: ParkingPlace, rng: np.random.Generator) -> tuple[Kind, float, float, float] | None:
    """Kind, centre (x, y) and yaw of the vehicle in a place; None where no kind fits."""
    fitting = [
        kind
        for kind in VEHICLES
        if kind.sumo_class in PARKING_CLASSES and kind.length_m <= place.length_m and kind.width_m <= place.width_m
    ]
    draw = rng.random()
    spread = np.clip(rng.standard_normal(3), -2.0, 2.0)
    backwards = rng.random() < BACKWARDS and place.orientation is not ParkingOrientation.PARALLEL
    if not fitting:
        return None
    ends = np.cumsum([kind.share for kind in fitting])
    kind = fitting[min(int(np.searchsorted(ends, draw * ends[-1], side="right")), len(fitting) - 1)]
    room_along, room_across = (place.length_m - kind.length_m) / 2, (place.width_m - kind.width_m) / 2
    turn_room = min(2 * room_along / kind.width_m, 2 * room_across / kind.length_m)
    turned = float(np.clip(SPREAD_YAW_RAD * spread[2], -turn_room, turn_room))
    # what turning adds to half of the body's extent, to first order an upper bound of |sin|
    room_along -= kind.width_m / 2 * abs(turned)
    room_across -= kind.length_m / 2 * abs(turned)
    along = float(np.clip(SPREAD_ALONG_M * spread[0], -room_along, room_along))
    across = float(np.clip(SPREAD_ACROSS_M * spread[1], -room_across, room_across))
    cos, sin = math.cos(place.yaw_rad), math.sin(place.yaw_rad)
    x = place.centre.x + along * cos - across * sin
    y = place.centre.y + along * sin + across * cos
    yaw = place.yaw_rad + turned + (math.pi if backwards else 0.0)
    return kind, x, y, math.remainder(yaw, math.tau)
