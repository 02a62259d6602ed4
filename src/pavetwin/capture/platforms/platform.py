"""Carriers of the camera: their context, the airspace they may use, the poses they propose, and their registry."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
import shapely

from pavetwin._core import Trace
from pavetwin.capture.image_spec import DefectIndex, ImageSpec
from pavetwin.capture.settings import CaptureSettings
from pavetwin.config import Conditions
from pavetwin.config.mission import VERTICAL_CLEARANCE_M, UavSettings
from pavetwin.navigation.navmesh import corridors
from pavetwin.registry import Registry
from pavetwin.scene.view import View
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.parked import ParkedVehicles, ParkingDraws
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, solids


@dataclass(frozen=True)
class Airspace:
    """The road corridors, and what stands in them."""

    corridors: shapely.Geometry
    """Less the UAV's radius; prepared."""
    standing: Solids
    bases: shapely.STRtree
    """(n,) of the solids."""
    radius_m: float
    """Radius of the UAV."""

    @classmethod
    def of(cls, world: World) -> Self:
        standing, radius_m = solids(world), UavSettings().radius_m
        free = shapely.buffer(corridors(world), -radius_m, quad_segs=4)
        shapely.prepare(free)
        bases = shapely.STRtree([shapely.Polygon(standing.base(index)) for index in range(len(standing))])
        return cls(free, standing, bases, radius_m)

    def contains(self, x_m: float, y_m: float, altitude_m: float) -> bool:
        """Return whether the UAV fits: within a corridor, and clear of obstacles at its altitude ± clearance."""
        place = shapely.Point(x_m, y_m)
        if not shapely.contains(self.corridors, place):
            return False
        near = self.bases.query(place, predicate="dwithin", distance=self.radius_m)
        low, high = altitude_m - VERTICAL_CLEARANCE_M, altitude_m + VERTICAL_CLEARANCE_M
        return not ((self.standing.z0[near] < high) & (self.standing.z1[near] > low)).any()


@dataclass(frozen=True)
class CaptureContext:
    """Inputs for camera poses: the world, its splits, the recorded traffic and the free airspace."""

    world: World
    settings: CaptureSettings
    defect_index: DefectIndex
    recordings: Mapping[str, Recording]
    """Keyed by density name."""
    traces: Mapping[str, Trace]
    airspace: Airspace
    """Airspace of the UAV."""

    def parked(self, conditions: Conditions, density: str) -> ParkedVehicles:
        """The vehicles that stand parked at the date and time of an image, of the mix of its traffic."""
        if not (parking := self.settings.parking).enabled:
            return ParkedVehicles.empty()
        mix = density_named(density).mix
        if mix not in self._parking_draws:
            self._parking_draws[mix] = ParkingDraws.of(self.world, self.settings.seed, mix)
        return self._parking_draws[mix].at(parking, conditions)

    @cached_property
    def _parking_draws(self) -> dict[str, ParkingDraws]:
        """Keyed by vehicle mix."""
        return {}


@dataclass(frozen=True)
class Pose:
    """A camera pose at a time of the recorded traffic."""

    view: View
    time_s: float
    yaw_rad: float
    """Yaw of the platform, anticlockwise from east; of a nadir image its upper edge."""
    pitch_rad: float
    """Pitch of the camera's axis: −π/2 straight down."""
    camera: Camera
    mount: str
    """Name of the camera on the platform."""
    ego: int | None = None
    """The agent that carries the camera; it is not drawn."""


class Platform(ABC):
    """Proposes camera poses. The caller checks each against the image spec and requests another if it does not fit."""

    uses_altitude: bool = False
    """True if it flies at an altitude of the settings with their camera; else it has cameras of its own."""

    def __init__(self, context: CaptureContext) -> None:
        self.context = context

    @classmethod
    def reaches(cls, world: World, recordings: Mapping[str, Recording]) -> set[str]:  # noqa: ARG003 - for others
        """The streets of which the platform can take images in every recording."""
        return {segment.street for segment in world.segments}

    @abstractmethod
    def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose | None:
        """A pose that may meet the spec, or None if this draw gives none.

        All randomness comes from `rng`.
        """


PLATFORMS: Registry[type[Platform]] = Registry(
    "platform", key="platform", group="pavetwin.platforms", home="pavetwin.capture.platforms"
)
platform = PLATFORMS.register
"""Register a platform under a name, which `platform` then takes."""


def flying(names: Iterable[str]) -> list[str]:
    """The platforms among `names` that fly at an altitude, with the camera of the settings.

    Raises:
        PaveTwinError: there is no such platform.
    """
    return [name for name in names if PLATFORMS.get(name).uses_altitude]
