"""What a platform is, and where platforms are registered."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin._core import NavMesh, Trace
from pavetwin.capture.plan import ImageSpec
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.sight import Sight
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.scene.view import View
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World


@dataclass(frozen=True)
class Setting:
    """Where and when images can be taken."""

    world: World
    settings: CaptureSettings
    sight: Sight
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

    def __init__(self, setting: Setting) -> None:
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


_PLATFORMS: Final[dict[str, type[Platform]]] = {}


def platform(name: str) -> Callable[[type[Platform]], type[Platform]]:
    """Register a platform under `name`, which `--platform` then takes."""

    def register(kind: type[Platform]) -> type[Platform]:
        if name in _PLATFORMS:
            raise ValueError(f"a platform '{name}' is registered already")
        kind.name = name
        _PLATFORMS[name] = kind
        return kind

    return register


def find_platform(name: str) -> type[Platform]:
    """The platform of that name.

    Raises:
        PaveTwinError: there is none; the message names the nearest.
    """
    if name not in _PLATFORMS:
        near = nearest_name(name, _PLATFORMS) or f"; there are {', '.join(_PLATFORMS)}"
        raise PaveTwinError(f"--platform: no platform '{name}'{near}.")
    return _PLATFORMS[name]
