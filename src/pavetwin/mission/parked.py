"""The vehicles that stand parked during a mission: which they are, as solids, as agents to draw, and what they hide."""

from dataclasses import dataclass, replace
from datetime import date, time
from typing import TYPE_CHECKING, Final, Self

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings
from pavetwin.config.conditions import Conditions
from pavetwin.config.parking import ParkingSettings
from pavetwin.mission.moment import agents_of
from pavetwin.navigation.patterns import Pass
from pavetwin.traffic.mix import DEFAULT_MIX
from pavetwin.traffic.parked import ParkedVehicles, parked_vehicles
from pavetwin.twin import Agent
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, parked_boxes

if TYPE_CHECKING:
    from pavetwin._core import Ground, NadirCamera, PoseColumns

FIRST_ID: Final = 2**31
"""Ids of parked vehicles as agents begin here; those of recorded traffic are lower."""

SAMPLE_M: Final = 0.5
"""Viewpoints along a pass by which `permanently_hidden` is found are at most this far apart."""


@dataclass(frozen=True, slots=True)
class ParkingInput:
    """What decides which vehicles are parked where in a world."""

    settings: ParkingSettings
    date: date
    time: time
    seed: int
    mix: str = DEFAULT_MIX
    """Name of the mix of vehicles."""

    @classmethod
    def of(cls, settings: MissionSettings, seed: int, mix: str = DEFAULT_MIX) -> Self:
        """Of a mission: its settings, and the seed and the mix of its parked vehicles."""
        return cls(settings.parking, settings.conditions.date, settings.conditions.time, seed, mix)

    def vehicles(self, world: World) -> ParkedVehicles:
        """Those that stand in the world's parking places."""
        conditions = Conditions(date=self.date, time=self.time)
        return parked_vehicles(world, self.settings, conditions, self.seed, self.mix)

    def is_as(self, other: Self, world: World) -> bool:
        """Whether the same vehicles stand in a world by both."""
        none = not world.parking or not (self.settings.enabled or other.settings.enabled)
        return none or self == other


def parked_columns(parked: ParkedVehicles) -> "PoseColumns":
    """Parked vehicles as agents that stand still, one array a column, in their order: what is drawn, rendered and
    labelled of them, just as the agents of a recording."""
    still = np.zeros(len(parked))
    return {
        "agent": (FIRST_ID + parked.place).astype(np.uint32),
        "x_m": parked.x,
        "y_m": parked.y,
        "yaw_rad": parked.yaw_rad,
        "east_mps": still,
        "north_mps": still,
        "length_m": parked.length_m,
        "width_m": parked.width_m,
        "height_m": parked.height_m,
        "is_pedestrian": np.zeros(len(parked), dtype=np.bool_),
    }


def parked_agents(parked: ParkedVehicles) -> tuple[Agent, ...]:
    """As `parked_columns`, as values."""
    return tuple(replace(agent, is_parked=True) for agent in agents_of(parked_columns(parked)))


def parked_solids(parked: ParkedVehicles) -> Solids:
    """The boxes of parked vehicles, which hide the ground."""
    xy = np.column_stack([parked.x, parked.y])
    return parked_boxes(xy, parked.yaw_rad, parked.length_m, parked.width_m, parked.height_m)


def permanently_hidden(
    ground: "Ground", segment: int, passes: list[Pass], camera: "NadirCamera", altitude_m: float
) -> float:
    """The share of a segment's cells that no capture along its passes can see because of parked vehicles.

    A cell counts when it lies in the inspection window of some viewpoint with nothing built or grown before it, and is
    seen from no viewpoint. Viewpoints are on the passes as planned, at both ends and `SAMPLE_M` or less apart, turned
    along the pass. Moving agents are left out.
    """
    places, yaws = zip(*(_viewpoints(line) for line in passes), strict=True)
    reach = ground.reach(segment, camera, altitude_m, np.concatenate(places), np.concatenate(yaws))
    return reach["permanently_hidden"] / reach["cells"]


def _viewpoints(line: Pass) -> tuple[Float64Array, Float64Array]:
    """Places (n, 2) along a pass and the yaws (n,) there."""
    path = shapely.LineString(line)
    at = np.linspace(0.0, path.length, max(2, int(np.ceil(path.length / SAMPLE_M)) + 1))
    places = shapely.get_coordinates(shapely.line_interpolate_point(path, at))
    legs = np.diff(line, axis=0)
    ends = np.cumsum(np.hypot(*legs.T))
    ahead = legs[np.minimum(np.searchsorted(ends, at), len(legs) - 1)]
    return places, np.arctan2(ahead[:, 1], ahead[:, 0])
