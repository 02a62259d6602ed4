"""Traffic density: vehicles per kilometre of lane and pedestrians per kilometre of sidewalk.

The denominators are the lengths of all driving lanes and of all sidewalks, between junctions. Agents on junctions and
crossings count in the numerator.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from pavetwin.errors import PaveTwinError, no_such
from pavetwin.world.model import LaneKind, World

TOLERANCE: Final = 0.20
"""A larger relative error of the achieved density becomes a remark."""

JAM_VEHICLES_PER_LANE_KM: Final = 133.0
"""One vehicle every 7.5 m (SUMO's 5 m car and 2.5 m gap): more cannot stand on a lane."""

USER: Final = "user"
"""The name of the density of a user's own routes."""


@dataclass(frozen=True, slots=True)
class Density:
    """Mean numbers of agents per kilometre, and a name for files."""

    name: str
    vehicles_per_lane_km: float
    pedestrians_per_sidewalk_km: float

    def __post_init__(self) -> None:
        for what, value in (
            ("vehicles per lane-kilometre", self.vehicles_per_lane_km),
            ("pedestrians per sidewalk-kilometre", self.pedestrians_per_sidewalk_km),
        ):
            if not math.isfinite(value) or value < 0:
                raise PaveTwinError(f"The density of {what} must be a number from 0 up, not {value:g}.")
        if self.vehicles_per_lane_km > JAM_VEHICLES_PER_LANE_KM:
            raise PaveTwinError(
                f"{self.vehicles_per_lane_km:g} vehicles per lane-kilometre do not fit on a lane: bumper to bumper "
                f"there are {JAM_VEHICLES_PER_LANE_KM:g}. Choose a density below that."
            )


DENSITIES: Final[Mapping[str, Density]] = MappingProxyType(
    {density.name: density for density in (Density("low", 6, 20), Density("medium", 15, 60), Density("high", 30, 120))}
)
"""The three densities of the design's section 4."""


_NUMBERS: Final = re.compile(r"v(\d+(?:\.\d+)?)-p(\d+(?:\.\d+)?)")


def density_named(name: str) -> Density:
    """The density called `name`: one of `DENSITIES`, or numbers as `density_of` names them (`v12-p40`).

    Raises:
        PaveTwinError: there is none; the message gives the nearest name.
    """
    if name in DENSITIES:
        return DENSITIES[name]
    if numbers := _NUMBERS.fullmatch(name):
        return density_of(float(numbers[1]), float(numbers[2]))
    form = "v12-p40 is 12 vehicles per kilometre of lane and 40 pedestrians per kilometre of sidewalk"
    raise PaveTwinError(no_such("density", name, DENSITIES, key="`density`", instead=f", or numbers: {form}"))


def density_of(vehicles_per_lane_km: float, pedestrians_per_sidewalk_km: float) -> Density:
    """A density of the user's own numbers, named after them (`v12-p40`)."""
    name = f"v{vehicles_per_lane_km:g}-p{pedestrians_per_sidewalk_km:g}"
    return Density(name, vehicles_per_lane_km, pedestrians_per_sidewalk_km)


@dataclass(frozen=True, slots=True)
class Capacity:
    """The denominators of the density in one world, in kilometres."""

    lanes_km: float
    sidewalks_km: float

    @classmethod
    def of(cls, world: World) -> "Capacity":
        return cls(world.length_km(LaneKind.DRIVING), world.length_km(LaneKind.SIDEWALK))

    def vehicles(self, density: Density) -> int:
        """How many vehicles make the density; at least one where any were asked for and a lane exists."""
        return _count(density.vehicles_per_lane_km * self.lanes_km)

    def pedestrians(self, density: Density) -> int:
        """How many pedestrians make the density; none in a world without sidewalks."""
        return _count(density.pedestrians_per_sidewalk_km * self.sidewalks_km)


def _count(expected: float) -> int:
    return 0 if expected <= 0 else max(1, round(expected))
