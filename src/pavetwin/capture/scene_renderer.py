"""The frame source of datasets and missions: the world's scene, drawn by the renderer."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from pavetwin._core import Trace
from pavetwin.capture.platforms import CaptureContext
from pavetwin.capture.samples import CameraSample, platform_key
from pavetwin.capture.settings import CaptureSettings
from pavetwin.render.frame import RenderedFrame
from pavetwin.render.nearby import FAR_M
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground.ground_plan import LAST_PART
from pavetwin.scene.ground.styles import DEFAULT_STYLE
from pavetwin.scene.light import Light
from pavetwin.scene.scene import SCENE_SEED, Scene, SceneCache
from pavetwin.scene.values import agent_label
from pavetwin.scene.view import View
from pavetwin.seeds import Stream, child
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.cameras import Camera
from pavetwin.world.model import World

_SHADOWS_M: Final = 40.0  # Distance beyond the image from which objects may cast a shadow into it


class SceneRenderer:
    """Renders images of a world with any of its recorded traffic.

    Raises:
        PaveTwinError: there is no graphics adapter.
    """

    def __init__(self, world: World, style: str = DEFAULT_STYLE) -> None:
        """Args:
        world: with its defects.
        style: of its streets: a name, or a YAML file.
        """
        self._scene = Scene(world, seed=SCENE_SEED, style=style)
        self._renderer = Renderer(self._scene)
        self._trace: tuple[Recording, Trace] | None = None

    @contextmanager
    def giving_up_by(self, check: Callable[[], None]) -> Iterator[None]:
        """While it lasts, frames are given up where the check, made between their steps, raises."""
        before, self._renderer.on_step = self._renderer.on_step, check
        try:
            yield
        finally:
            self._renderer.on_step = before

    def picture(
        self,
        view: View,
        camera: Camera,
        light: Light,
        recording: Recording,
        time_s: float,
        *,
        noise: int,
        parked: ParkedVehicles,
        without: int | None = None,
        compensation_ev: float = 0.0,
        truth: bool = True,
    ) -> RenderedFrame:
        """The image of a camera at a time of the recording.

        Args:
            noise: seed of the sensor's noise.
            parked: the vehicles that stand in the world's parking places.
            without: the agent that carries the camera; only its shadow is drawn.
            compensation_ev: how much brighter than metered, in stops.
            truth: with labels, and the same image without defects; the image itself is the same without.
        """
        near = (float(view.position[0]), float(view.position[1]), self._radius_m(view))
        ego = None if without is None else agent_label(without)
        agents = self._scene.agents(recording, time_s, near)
        instances = [each for each in agents if each.label != ego or not ego]
        instances += self._scene.parked(parked, near)
        velocities = self._velocities(recording, time_s, near)
        self._scene.make_plan()
        return self._renderer.frame(
            view,
            light=light,
            camera=camera,
            instances=instances,
            shadow_only=[each for each in agents if ego and each.label == ego],
            compensation_ev=compensation_ev,
            seed=noise,
            labels=truth,
            depth=False,
            defect_free=truth,
            velocities=velocities,
        )

    def _radius_m(self, view: View) -> float:
        """Distance within which agents can be seen or cast a shadow into the image."""
        width, height = view.size_px
        hits = view.ground([(0, 0), (width, 0), (width, height), (0, height)])
        reach = float(np.max(np.linalg.norm(hits - view.position[:2], axis=1)))
        return min(FAR_M, reach + _SHADOWS_M) if np.isfinite(reach) else FAR_M

    def _velocities(
        self, recording: Recording, time_s: float, near: tuple[float, float, float]
    ) -> Mapping[int, npt.ArrayLike]:
        if self._trace is None or self._trace[0] is not recording:
            self._trace = recording, trace_of(recording)
        poses = self._trace[1].agents_near(*near, time_s)
        moves = np.column_stack([poses["east_mps"], poses["north_mps"], np.zeros(len(poses["agent"]))])
        return {agent_label(int(agent)): move for agent, move in zip(poses["agent"], moves, strict=True)}


class SceneFrameSource:
    """Renders the camera samples of a dataset."""

    _begun: ClassVar[list[tuple[World, SceneRenderer]]] = []
    """Renderer made by `begin`, until a source takes it."""

    def __init__(self, context: CaptureContext) -> None:
        if self._begun and self._begun[0][0] is context.world:
            _, self._scene_renderer = self._begun.pop()
        else:
            self._scene_renderer = SceneRenderer(context.world, context.settings.style)

    @classmethod
    def begin(cls, world: World, settings: CaptureSettings) -> None:
        """Create the renderer of a world before its traffic is known, for the next source."""
        cls._begun[:] = [(world, SceneRenderer(world, settings.style))]

    @staticmethod
    def is_new(world: World, settings: CaptureSettings) -> bool | None:
        """Return whether the plan of a world's ground is missing in the cache; None if nothing of it is kept."""
        cache = SceneCache(world, seed=SCENE_SEED, style=settings.style)
        return cache.lacks(LAST_PART) if cache.keeps else None

    def frame(self, sample: CameraSample, context: CaptureContext) -> RenderedFrame:
        """The same sample gives the same frame, whatever was rendered before."""
        spec = sample.spec
        rng = child(context.settings.seed, Stream.FRAME, platform_key(spec.platform), spec.index, sample.attempt)
        return self._scene_renderer.picture(
            sample.pose.view,
            sample.pose.camera,
            sample.daylight.light,
            context.recordings[spec.density],
            sample.pose.time_s,
            noise=int(rng.integers(1 << 62)),
            parked=context.parked(sample.conditions, spec.density),
            without=sample.pose.ego,
            compensation_ev=sample.daylight.compensation_ev,
        )
