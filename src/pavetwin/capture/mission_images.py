"""The images of a mission's captures, rendered from the world, its defects and the traffic the mission replays.

Sensors that look at images get them here in flight, saved frames after it: the same capture gives the same image. Until
the first image is requested, nothing that renders is loaded.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final

from pavetwin.arrays import UInt8Array
from pavetwin.config import MissionSettings
from pavetwin.mission.replay import Replay
from pavetwin.seeds import Stream, child
from pavetwin.sensing import Frame
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import World

if TYPE_CHECKING:
    from pavetwin.capture.scene_renderer import SceneRenderer
    from pavetwin.render.frame import RenderedFrame


def check_frames(settings: MissionSettings, world: World) -> None:
    """Check that frames of a mission can be taken.

    Raises:
        PaveTwinError: there is no adapter to draw with, or the sun is below the horizon.
    """
    from pavetwin.capture.daylight import Daylight
    from pavetwin.render.adapter import find_adapter

    find_adapter()
    Daylight.of(settings.conditions, world)


@dataclass
class MissionImages:
    """The image source of missions that share a world, traffic and a seed, see `pavetwin.sensing.ImageSource`.

    Noise follows from (seed, the capture's number). The light stays as it is when the mission begins.
    """

    world: World
    """With the defects that the missions look for, see `MissionEnvironment.inspected_world`."""
    replay: Replay
    seed: int
    """Seed of the missions' sensors."""
    parked: ParkedVehicles = field(default_factory=ParkedVehicles.empty)
    """See `MissionEnvironment.parked`."""

    def __call__(self, frame: Frame) -> UInt8Array:
        """(height, width, 3) sRGB, of the camera's `image_px`.

        Raises:
            PaveTwinError: there is no adapter to draw with, or the sun is below the horizon.
        """
        return self.rendered(frame, truth=False).rgb

    def rendered(self, frame: Frame, size_px: tuple[int, int] | None = None, *, truth: bool = True) -> "RenderedFrame":
        """The image of a capture with its ground truth.

        Args:
            size_px: width, height; the camera's own unless given. The field of view stays.
            truth: with labels; the image itself is the same without.

        Raises:
            PaveTwinError: as `__call__`.
        """
        from pavetwin.capture.daylight import Daylight
        from pavetwin.scene.view import nadir

        view = nadir(
            frame.camera,
            (*frame.position, frame.altitude_m),
            yaw_rad=frame.yaw_rad,
            size_px=size_px,
            velocity_mps=(*frame.velocity_mps, 0.0),
        )
        return self.scene_renderer.picture(
            view,
            frame.camera,
            Daylight.of(frame.conditions, self.world).light,
            self.replay.recording,
            self.replay.recorded_s(frame.time_s),
            noise=int(child(self.seed, Stream.FRAME, frame.number).integers(1 << 62)),
            parked=self.parked,
            truth=truth,
        )

    @cached_property
    def scene_renderer(self) -> "SceneRenderer":
        return _renderer_of(self.world)


_LATEST: Final[list[tuple[World, "SceneRenderer"]]] = []
"""The world whose scene was built last, if any: a study flies over one with many recordings in turn, and building a
scene takes as long as some ten images."""


def _renderer_of(world: World) -> "SceneRenderer":
    from pavetwin.capture.scene_renderer import SceneRenderer

    if not _LATEST or _LATEST[0][0] is not world:
        _LATEST.clear()
        _LATEST.append((world, SceneRenderer(world)))
    return _LATEST[0][1]
