"""Shared by all images: the demo's town, its traffic, its scene, and one renderer."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin._core import Trace
from pavetwin.cli.demo import TOWN_SEED
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.files import writing
from pavetwin.render.frame import METERED, Exposure, programme
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground import GroundPlan, plan_ground
from pavetwin.scene.ground.styles import DEFAULT_STYLE, street_style
from pavetwin.scene.light import LUMINANCE, Light, harmonics
from pavetwin.scene.scene import Scene
from pavetwin.scene.values import Instance, labelled_agent
from pavetwin.scene.view import View
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.cameras import Camera, find_camera
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world

Picture = npt.NDArray[np.uint8]

RECORDED_S: Final = 600.0
SEED: Final = 1
DENSITY: Final = "high"

GREY: Final = 0.14
"""Reflectance of asphalt of some years."""

MORNING: Final = Light(38.0, 118.0, cloud_cover=0.1)
LOW_SUN: Final = Light(16.0, 255.0, cloud_cover=0.15, turbidity=4.0)
OVERCAST: Final = Light(45.0, 190.0, cloud_cover=1.0)


@dataclass
class GalleryRenderer:
    """Opens worlds, traffic and the renderer on demand."""

    folder: Path
    population: str = "survey"
    """Of the town's damage."""
    style: str = DEFAULT_STYLE
    """Of its streets."""
    source: str | Path = "town"
    options: BuildOptions = field(default_factory=lambda: BuildOptions(seed=TOWN_SEED))
    """What the town is built from, and how."""
    maps: Path | None = None
    """Folder of OpenStreetMap extracts for images of several towns."""

    @classmethod
    def with_markings(cls, folder: Path, markings: str | None) -> "GalleryRenderer":
        """The town with the default style and a marking standard; that of its place for None."""
        if markings is None:
            return cls(folder)
        style = folder / f"markings-{markings}.yaml"
        shipped = files("pavetwin.scene.ground.styles").joinpath("streets", f"{DEFAULT_STYLE}.yaml")
        with writing(style) as temporary:
            temporary.write_text(f"{shipped.read_text(encoding='utf-8')}markings: {markings}\n", encoding="utf-8")
        return cls(folder, style=str(style))

    @cached_property
    def paper(self) -> "GalleryRenderer":
        """The town with the damage of the paper, which has every class at every severity."""
        return GalleryRenderer(self.folder / "paper", "paper")

    @cached_property
    def world(self) -> World:
        town = self.folder / "town"
        if town.is_dir():
            return load_world(town)
        damage = DefectOptions(population=self.population)
        return save_world(add_defects(build_world(self.source, self.options), damage), town)

    @cached_property
    def recording(self) -> Recording:
        return record(self.world, DENSITY, SEED, RECORDED_S)

    @cached_property
    def trace(self) -> Trace:
        return trace_of(self.recording)

    @cached_property
    def scene(self) -> Scene:
        return Scene(self.world, seed=SEED, style=self.style)

    @cached_property
    def plan(self) -> GroundPlan:
        """Of the town's streets: their pavements and what is painted on them."""
        return plan_ground(self.world, SEED, style=street_style(self.style))

    @cached_property
    def renderer(self) -> Renderer:
        return Renderer(self.scene)

    @cached_property
    def camera(self) -> Camera:
        return find_camera("phantom4pro")

    def take(
        self,
        view: View,
        light: Light,
        *,
        time_s: float | None = None,
        without: int | None = None,
        more: Sequence[Instance] = (),
        exposure: Exposure | None = None,
        compensation_ev: float = 0.0,
    ) -> Picture:
        """A image (height, width, 3).

        Args:
            view: the camera.
            light: sun and sky.
            time_s: of the recording; None for empty streets.
            without: an agent that is left out: the car that carries the camera.
            more: additional instances.
            exposure: None for automatic exposure.
            compensation_ev: added to automatic exposure, in stops.
        """
        near = (float(view.position[0]), float(view.position[1]), 160.0)
        agents = self.scene.agents(None if time_s is None else self.recording, time_s or 0.0, near)
        shown = [agent for agent in agents if without is None or labelled_agent(agent.label) != without]
        frame = self.renderer.frame(
            view,
            light=light,
            camera=self.camera,
            instances=[*shown, *more],
            exposure=exposure,
            compensation_ev=compensation_ev,
            seed=SEED,
            labels=False,
            depth=False,
        )
        return frame.rgb

    def grey_card(self, light: Light, compensation_ev: float = 0.0) -> Exposure:
        """The exposure for level ground of `GREY` in the open, and some stops more: what is paler or darker stays so
        in the image."""
        shade = light.sky_irradiance.T @ harmonics(np.array([0.0, 0.0, 1.0]))
        lit = float((light.sun_klux * light.to_sun[2] + shade) @ LUMINANCE)
        return programme(self.camera, METERED / (GREY * lit / np.pi) * 2.0**compensation_ev)
