"""What a platform is, and where platforms are registered."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pavetwin._core import Trace
from pavetwin.capture.airspace import Airspace
from pavetwin.capture.defect_index import DefectIndex
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.settings import CaptureSettings
from pavetwin.config import Conditions
from pavetwin.registry import Registry
from pavetwin.scene.view import View
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.parked import ParkedVehicles, ParkingDraws
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World


@dataclass(frozen=True)
class CaptureContext:
    """What platforms draw camera poses from: the world, its splits, the recorded traffic and the free airspace."""

    world: World
    settings: CaptureSettings
    defect_index: DefectIndex
    recordings: Mapping[str, Recording]
    """By density name."""
    traces: Mapping[str, Trace]
    airspace: Airspace
    """Where the UAV may be."""

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
        """By name of the mix of vehicles."""
        return {}


@dataclass(frozen=True)
class Pose:
    """A camera pose at a time of the recorded traffic."""

    view: View
    time_s: float
    yaw_rad: float
    """Of the platform, anticlockwise from east; of a nadir image its upper edge."""
    pitch_rad: float
    """Of the camera's axis: −π/2 straight down."""
    camera: Camera
    mount: str
    """Which of the platform's cameras."""
    ego: int | None = None
    """The agent that carries the camera; it is not drawn."""


class Platform(ABC):
    """Proposes camera poses. The caller checks each against the image spec and requests another if it does not fit."""

    uses_altitude: bool = False
    """Whether it flies, at an altitude of the settings and with their camera; else it has cameras of its own."""

    def __init__(self, context: CaptureContext) -> None:
        self.context = context

    @classmethod
    def reaches(cls, world: World, recordings: Mapping[str, Recording]) -> set[str]:  # noqa: ARG003 - for others
        """The streets of which it can take images in every one of the recordings."""
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
    """Those of some platforms that fly at an altitude with the camera of the settings.

    Raises:
        PaveTwinError: there is no such platform.
    """
    return [name for name in names if PLATFORMS.get(name).uses_altitude]
