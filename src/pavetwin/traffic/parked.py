"""Vehicles that stand in a world's parking places.

They are static: drawn once for a mission from its settings, its date and time and a seed, without SUMO. What stands in
a place depends on the seed and the place alone, never on other places. A place that is taken at one occupancy is taken,
by the same vehicle, at every higher one.

`occupancy.yaml` has the daily curves of occupancy for each kind of surroundings, and their sources. Between full hours
they are straight lines.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from importlib.resources import files
from types import MappingProxyType
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import Field, PositiveFloat

from pavetwin.arrays import BoolArray, Float64Array, IndexArray, Int64Array
from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.config.settings import Settings, Share
from pavetwin.config.text import parse_yaml
from pavetwin.seeds import Stream, child
from pavetwin.traffic.demand import DEFAULT_MIX, mix_named
from pavetwin.traffic.kinds import Kind
from pavetwin.world.model import World
from pavetwin.world.parking.mapped import is_within
from pavetwin.world.parking.place import ParkingOrientation, ParkingPlace

SATURDAY: Final = 5
"""First day of the weekend in `datetime.date.weekday`."""

SPEED_ROUNDED_KMH: Final = 0.5
"""Networks hold speed limits in rounded metres a second: 13.89 for 50 km/h, or 13.9."""

Surroundings = Literal["residential", "mixed"]
DayKind = Literal["weekday", "weekend"]
DailyCurve = Annotated[tuple[Share, ...], Field(min_length=24, max_length=24)]
"""Share at each full hour, 0 to 23."""


class OccupancyCurves(Settings):
    """The contents of `occupancy.yaml`."""

    surroundings: Mapping[str, Surroundings]
    """Occupancy by OSM's class of the street."""
    otherwise: Surroundings
    """Occupancy of all other streets."""
    unclassed_mixed_kmh: PositiveFloat
    """Streets without a class, as of generated towns and SUMO networks, are mixed from this speed limit on."""
    curves: Mapping[Surroundings, Mapping[DayKind, DailyCurve]]


@cache
def occupancy_curves() -> OccupancyCurves:
    """The curves that ship with the package."""
    name = "occupancy.yaml"
    text = (files("pavetwin.traffic") / name).read_text(encoding="utf-8")
    return OccupancyCurves.parse(parse_yaml(text, where=name), where=name)


def surroundings_of(street_kind: str, speed_limit_mps: float = 0.0) -> Surroundings:
    """Occupancy by SUMO's type of an edge, such as `highway.residential`; without a class, by its speed limit."""
    data = occupancy_curves()
    if not street_kind.startswith("highway."):
        return "mixed" if 3.6 * speed_limit_mps >= data.unclassed_mixed_kmh - SPEED_ROUNDED_KMH else data.otherwise
    return data.surroundings.get(street_kind.removeprefix("highway.").removesuffix("_link"), data.otherwise)


def occupancy(surroundings: Surroundings, conditions: Conditions) -> float:
    """The share of places that are taken at the date and time of the conditions, 0 … 1."""
    day: DayKind = "weekend" if conditions.date.weekday() >= SATURDAY else "weekday"
    curve = occupancy_curves().curves[surroundings][day]
    hour = conditions.time.hour + conditions.time.minute / 60
    return float(np.interp(hour, np.arange(25), [*curve, curve[0]]))


SPREAD_ALONG_M: Final = 0.25
SPREAD_ACROSS_M: Final = 0.10
SPREAD_YAW_RAD: Final = math.radians(1.5)
"""Standard deviations of how a vehicle stands in its place; each is cut at two of them. Ours."""

BACKWARDS: Final = 0.2
"""Share of the vehicles in diagonal and perpendicular places that have been reversed into them. Ours."""

PARKING_CLASSES: Final = frozenset({"passenger", "delivery", "motorcycle", "moped"})
"""SUMO vehicle classes that park at the roadside, where they fit."""

RIDERLESS_HEIGHT_M: Final[Mapping[str, float]] = MappingProxyType({"motorcycle": 1.30, "scooter": 1.30})
"""Height of the kinds that stand without their rider, leaning: up to the mirrors. Scooters are drawn as motorcycles."""


@dataclass(frozen=True, eq=False)
class ParkedVehicles:
    """Parked vehicles, in the order of the world's places. All arrays (vehicles,)."""

    place: IndexArray
    """Index in `World.parking`."""
    kind: tuple[str, ...]
    """One of `kinds.KINDS`."""
    x: Float64Array
    """Centre of the body on the ground, metres east."""
    y: Float64Array
    """Metres north."""
    yaw_rad: Float64Array
    """Direction of its front, anticlockwise from east, −π … π."""
    length_m: Float64Array
    width_m: Float64Array
    height_m: Float64Array
    appearance: Int64Array
    """Keys of their appearance: what is parked there another time or under another seed looks different."""

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
        return cls(np.zeros(0, dtype=np.intp), (), none, none, none, none, none, none, np.zeros(0, dtype=np.int64))

    def only(self, which: BoolArray | IndexArray) -> Self:
        """Some of them: a mask (vehicles,), or their rows in order."""
        rows = np.flatnonzero(which) if which.dtype == np.bool_ else which
        arrays = {each.name: getattr(self, each.name)[rows] for each in fields(self) if each.name != "kind"}
        return replace(self, kind=tuple(self.kind[row] for row in rows.tolist()), **arrays)

    def near(self, x_m: float, y_m: float, radius_m: float) -> Self:
        """Vehicles whose body may reach into a disc."""
        reach = radius_m + np.hypot(self.length_m, self.width_m) / 2
        return self.only(np.hypot(self.x - x_m, self.y - y_m) <= reach)


@dataclass(frozen=True, eq=False)
class ParkingDraws:
    """Draws of one seed for every place of a world: the vehicle that stands there when it is taken. The
    places taken at a date and time follow quickly."""

    world: World
    occupancy: Float64Array
    """(vehicles,) its place is taken where the share of places that are taken is larger than this."""
    vehicles: ParkedVehicles
    """A vehicle in every place in which any kind fits."""

    @classmethod
    def of(cls, world: World, seed: int, mix: str = DEFAULT_MIX) -> Self:
        """Draw for the places of a world, where a mix of vehicles parks.

        Raises:
            PaveTwinError: there is no such mix.
        """
        parking = [(kind, share) for kind, share in mix_named(mix).vehicles if kind.sumo_class in PARKING_CLASSES]
        drawn: list[tuple[int, float, Kind, float, float, float, int]] = []
        for index, place in enumerate(world.parking):
            rng = child(seed, Stream.PARKING, place.key)
            occupancy = float(rng.random())
            if (vehicle := _vehicle_in(place, parking, rng)) is not None:
                drawn.append((index, occupancy, *vehicle, int(rng.integers(1 << 32))))
        if not drawn:
            return cls(world, np.zeros(0), ParkedVehicles.empty())
        places, shares, kinds, x, y, yaw, appearance = zip(*drawn, strict=True)
        vehicles = ParkedVehicles(
            np.array(places, dtype=np.intp),
            tuple(kind.name for kind in kinds),
            np.array(x),
            np.array(y),
            np.array(yaw),
            np.array([kind.length_m for kind in kinds]),
            np.array([kind.width_m for kind in kinds]),
            np.array([RIDERLESS_HEIGHT_M.get(kind.name, kind.height_m) for kind in kinds]),
            np.array(appearance, dtype=np.int64),
        )
        return cls(world, np.array(shares), vehicles)

    def at(self, settings: ParkingSettings, conditions: Conditions) -> ParkedVehicles:
        """The vehicles that stand there at the date and time of the conditions.

        Each stands within its place, so that none overlaps another and none reaches beyond its neighbours.
        """
        if not settings.enabled or not len(self.vehicles):
            return ParkedVehicles.empty()
        if settings.occupancy is None:
            around, rows = self._surroundings
            share = np.array([occupancy(each, conditions) for each in around])[rows]
        else:
            share = np.full(len(self.occupancy), settings.occupancy)
        taken = self.occupancy < share
        for row, hours in self._closed:
            taken[row] &= not is_within(hours, conditions.date, conditions.time)
        return self.vehicles.only(taken)

    @cached_property
    def _surroundings(self) -> tuple[list[Surroundings], IndexArray]:
        """The surroundings of streets with places, and (vehicles,) which of them each stands in."""
        lanes = self.world.lanes_by_edge
        of_street: dict[str, Surroundings] = {
            street.id: surroundings_of(
                street.kind,
                max((lane.speed_limit_mps for edge in street.edges for lane in lanes.get(edge, ())), default=0.0),
            )
            for street in self.world.streets
        }
        each = [
            of_street.get(self.world.parking[at].street, surroundings_of("")) for at in self.vehicles.place.tolist()
        ]
        kinds = list(dict.fromkeys(each))
        return kinds, np.array([kinds.index(one) for one in each], dtype=np.intp)

    @cached_property
    def _closed(self) -> list[tuple[int, str]]:
        """Vehicles, and the hours without parking at their places."""
        hours = [self.world.parking[place].closed for place in self.vehicles.place.tolist()]
        return [(row, closed) for row, closed in enumerate(hours) if closed]


def parked_vehicles(
    world: World, settings: ParkingSettings, conditions: Conditions, seed: int, mix: str = DEFAULT_MIX
) -> ParkedVehicles:
    """The vehicles that are parked in a world at the date and time of the conditions; see `ParkingDraws`."""
    if not settings.enabled:
        return ParkedVehicles.empty()
    return ParkingDraws.of(world, seed, mix).at(settings, conditions)


def _vehicle_in(
    place: ParkingPlace, parking: Sequence[tuple[Kind, float]], rng: np.random.Generator
) -> tuple[Kind, float, float, float] | None:
    """Kind, centre (x, y) and yaw of the vehicle in a place, of the kinds that park and their shares; None where no
    kind fits."""
    fitting = [
        (kind, share) for kind, share in parking if kind.length_m <= place.length_m and kind.width_m <= place.width_m
    ]
    draw = rng.random()
    spread = np.clip(rng.standard_normal(3), -2.0, 2.0)
    backwards = rng.random() < BACKWARDS and place.orientation is not ParkingOrientation.PARALLEL
    if not fitting:
        return None
    ends = np.cumsum([share for _, share in fitting])
    kind, _ = fitting[min(int(np.searchsorted(ends, draw * ends[-1], side="right")), len(fitting) - 1)]
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
