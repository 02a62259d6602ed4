"""How much traffic: a density, a level of service or an hour of a weekday, and the mix of vehicles.

A density is vehicles per kilometre of lane and pedestrians per kilometre of sidewalk. The denominators are the lengths
of all driving lanes and of all sidewalks, between junctions. Agents on junctions and crossings count in the numerator.
Which density gives a level of service or carries the traffic of an hour depends on the world: see `demand_search`.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.level_of_service import LevelOfService, level_named
from pavetwin.traffic.mix import DEFAULT_MIX, mix_named
from pavetwin.world.model import LaneKind, World

TOLERANCE: Final = 0.20
"""A larger relative error of the achieved density becomes a remark."""

JAM_VEHICLES_PER_LANE_KM: Final = 133.0
"""One vehicle every 7.5 m (SUMO's 5 m car and 2.5 m gap): more cannot stand on a lane."""

USER: Final = "user"
"""The name of the density of a user's own routes."""


MIXED: Final = "+"
"""Before the mix in a name, where it is not the default one: `high+south_asia`."""

_LEVEL: Final = "los-"
_HOUR: Final = "hour-"

DEFAULT_TRAFFIC: Final = f"{_LEVEL}{LevelOfService.C}"
"""Of missions and datasets, where none is named."""

PEDESTRIANS: Final = 60.0
"""Per kilometre of sidewalk in every level of service, and in the busiest hour: those of the density medium. The
Highway Capacity Manual grades vehicles only."""

HOURLY_SHARES: Final = (
    *(0.8, 0.5, 0.4, 0.3, 0.4, 1.2, 4.5, 7.4, 6.6, 5.2, 5.0, 5.0),
    *(5.2, 5.3, 5.6, 6.7, 8.4, 8.6, 7.4, 5.0, 3.9, 3.0, 2.1, 1.6),
)
"""Percent of a day's cars in each hour from 0 to 23 o'clock, Tuesday to Thursday, at the edge of the inner cities of
West Germany: Schmidt and Thomas 1996 (Forschung Straßenbau und Straßenverkehrstechnik 732), p. 95, as the SUMO
documentation has it (`TGw2_PKW`)."""

SEARCH: Final = 3
"""Version of the demand of a level of service or an hour, and of the search for it (`demand_search`)."""

HOURS: Final = 2
"""Version of how the demand of an hour follows from that of the busiest one (`demand_search`)."""

BUSIEST: Final = LevelOfService.D
"""Of the busiest hour. An assumption of ours: streets are built to work at capacity's edge on a usual weekday."""


@dataclass(frozen=True, slots=True)
class Density:
    """Mean numbers of agents per kilometre, and a name for files, which holds the rest."""

    name: str
    vehicles_per_lane_km: float | None
    """None for a level of service or an hour whose density in a world is not found yet."""
    pedestrians_per_sidewalk_km: float

    def __post_init__(self) -> None:
        for what, value in (
            ("vehicles per lane-kilometre", self.vehicles_per_lane_km),
            ("pedestrians per sidewalk-kilometre", self.pedestrians_per_sidewalk_km),
        ):
            if value is not None and (not math.isfinite(value) or value < 0):
                raise PaveTwinError(f"The density of {what} must be a number from 0 up, not {value:g}.")
        if self.vehicles_per_lane_km is not None and self.vehicles_per_lane_km > JAM_VEHICLES_PER_LANE_KM:
            raise PaveTwinError(
                f"{self.vehicles_per_lane_km:g} vehicles per lane-kilometre do not fit on a lane: bumper to bumper "
                f"there are {JAM_VEHICLES_PER_LANE_KM:g}. Choose a density below that."
            )

    @property
    def level(self) -> LevelOfService | None:
        """The level of service that is asked for."""
        name = self._base
        return LevelOfService(name.removeprefix(_LEVEL)) if name.startswith(_LEVEL) else None

    @property
    def hour(self) -> int | None:
        """The hour of a weekday that is asked for, 0 … 23."""
        name = self._base
        return int(name.removeprefix(_HOUR)) if name.startswith(_HOUR) else None

    @property
    def is_found(self) -> bool:
        """Whether its density is found by closed loop, and not given as a number."""
        return self.level is not None or self.hour is not None

    @property
    def mix(self) -> str:
        """Name of the mix of vehicles."""
        return self.name.partition(MIXED)[2] or DEFAULT_MIX

    @property
    def _base(self) -> str:
        return self.name.partition(MIXED)[0]


DENSITIES: Final[Mapping[str, Density]] = MappingProxyType(
    {density.name: density for density in (Density("low", 6, 20), Density("medium", 15, 60), Density("high", 30, 120))}
)
"""The three densities of the design's section 4."""


_NUMBERS: Final = re.compile(r"v(\d+(?:\.\d+)?)-p(\d+(?:\.\d+)?)")


def density_named(name: str, mix: str = "") -> Density:
    """The traffic called `name`: one of `DENSITIES`, numbers as `density_of` names them (`v12-p40`), a level of service
    (`los-C`) or an hour of a weekday (`hour-08`); each with a mix behind a plus sign (`los-C+south_asia`).

    Args:
        mix: a mix's name, where the traffic's name has none.

    Raises:
        PaveTwinError: there is none; the message gives the nearest name.
    """
    base, _, own = name.partition(MIXED)
    if own and mix and own != mix:
        raise PaveTwinError(f"`mix` {mix}: the traffic '{name}' has the mix {own}; give one of them.")
    found, mix = _without_mix(base), own or mix or DEFAULT_MIX
    mix_named(mix)
    return found if mix == DEFAULT_MIX else replace(found, name=f"{found.name}{MIXED}{mix}")


def _without_mix(name: str) -> Density:
    if name in DENSITIES:
        return DENSITIES[name]
    if name.startswith(_LEVEL):
        return level_density(name.removeprefix(_LEVEL))
    if name.startswith(_HOUR):
        return hour_density(name.removeprefix(_HOUR))
    if numbers := _NUMBERS.fullmatch(name):
        return density_of(float(numbers[1]), float(numbers[2]))
    form = "v12-p40 is 12 vehicles per kilometre of lane and 40 pedestrians per kilometre of sidewalk"
    known = (*DENSITIES, *(f"{_LEVEL}{level}" for level in LevelOfService), f"{_HOUR}08")
    raise PaveTwinError(no_such("density", name, known, key="`density`", instead=f", or numbers: {form}"))


def density_of(vehicles_per_lane_km: float, pedestrians_per_sidewalk_km: float) -> Density:
    """A density of the user's own numbers, named after them (`v12-p40`)."""
    name = f"v{vehicles_per_lane_km:g}-p{pedestrians_per_sidewalk_km:g}"
    return Density(name, vehicles_per_lane_km, pedestrians_per_sidewalk_km)


def level_density(level: str) -> Density:
    """The traffic of a level of service, A to F, whose density is not found yet.

    Raises:
        PaveTwinError: there is no such class.
    """
    return Density(f"{_LEVEL}{level_named(level)}", None, PEDESTRIANS)


def hour_density(hour: str | int) -> Density:
    """The traffic of an hour of a weekday, 0 to 23, whose density is not found yet.

    Raises:
        PaveTwinError: there is no such hour.
    """
    number = int(hour) if str(hour).isdecimal() else -1
    if not 0 <= number < len(HOURLY_SHARES):
        raise PaveTwinError(f"`hour` {hour}: expected a whole number from 0 to 23.")
    return Density(f"{_HOUR}{number:02}", None, PEDESTRIANS * share_of_busiest(number))


def share_of_busiest(hour: int) -> float:
    """The traffic of an hour, as a share of that of the busiest one."""
    return HOURLY_SHARES[hour] / max(HOURLY_SHARES)


@dataclass(frozen=True, slots=True)
class Capacity:
    """The denominators of the density in one world or area, in kilometres."""

    lanes_km: float
    sidewalks_km: float

    @classmethod
    def of(cls, world: World, area: TrafficArea | None = None) -> "Capacity":
        if area is not None:
            return cls(area.length_km(world), area.length_km(world, LaneKind.SIDEWALK))
        return cls(world.length_km(LaneKind.DRIVING), world.length_km(LaneKind.SIDEWALK))

    def vehicles(self, density: Density) -> int:
        """How many vehicles make the density; at least one where any were asked for and a lane exists."""
        if density.vehicles_per_lane_km is None:
            raise ValueError(f"The density of {density.name} is not found yet")
        return _count(density.vehicles_per_lane_km * self.lanes_km)

    def pedestrians(self, density: Density) -> int:
        """How many pedestrians make the density; none in a world without sidewalks."""
        return _count(density.pedestrians_per_sidewalk_km * self.sidewalks_km)


def _count(expected: float) -> int:
    return 0 if expected <= 0 else max(1, round(expected))
