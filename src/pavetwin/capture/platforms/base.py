"""What a platform is, and where platforms are registered."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pavetwin._core import NavMesh, Trace
from pavetwin.capture.plan import ImageSpec
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.sight import DefectIndex
from pavetwin.registry import Registry
from pavetwin.scene.view import View
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World


@dataclass(frozen=True)
class CaptureContext:
    """Where and when images can be taken."""

    world: World
    settings: CaptureSettings
    sight: DefectIndex
    recordings: Mapping[str, Recording]
    """By the name of their density."""
    traces: Mapping[str, Trace]
    meshes: Mapping[float, NavMesh]
    """Where the UAV may be, by altitude in metres; empty for what drives."""


@dataclass(frozen=True)
class Pose:
    """A camera somewhere at some time in the traffic."""

    view: View
    time_s: float
    yaw_rad: float
    """Of the platform, anticlockwise from east."""
    pitch_rad: float
    """Of the camera's axis: −π/2 straight down."""
    camera: Camera
    mount: str
    """Which of the platform's cameras."""
    ego: int | None = None
    """The agent that carries it and is not drawn."""


class Platform(ABC):
    """Proposes poses; whoever asked looks whether one suits, and asks again."""

    name: str = ""
    uses_altitude: bool = False

    def __init__(self, setting: CaptureContext) -> None:
        self.setting = setting

    @classmethod
    def reaches(cls, world: World, recordings: Mapping[str, Recording]) -> set[str]:  # noqa: ARG003 - for others
        """The streets that it can take images of in every one of the recordings."""
        return {segment.street for segment in world.segments}

    @abstractmethod
    def propose(self, spec: ImageSpec, rng: np.random.Generator) -> Pose | None:
        """A pose that may show what is wished, or None when the luck of `rng` led nowhere.

        Everything drawn is drawn from `rng`.
        """


def _named(name: str, kind: type[Platform]) -> None:
    kind.name = name


PLATFORMS: Registry[type[Platform]] = Registry(
    "platform", key="platform", group="pavetwin.platforms", home="pavetwin.capture.platforms", on_add=_named
)
platform = PLATFORMS.register
"""Register a platform under a name, which `platform` then takes."""
