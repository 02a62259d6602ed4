"""Lamps in frames: what SUMO's traffic does is seen where the lamp is, and nowhere else."""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
import pytest
import shapely

from pavetwin.render.renderer import Renderer
from pavetwin.scene.agents import Actors, upright
from pavetwin.scene.light import Light
from pavetwin.scene.models import library
from pavetwin.scene.signals import VEHICLES as FOR_VEHICLES
from pavetwin.scene.signals import WALKERS, Head, instances
from pavetwin.scene.values import Instance
from pavetwin.scene.view import View, look
from pavetwin.traffic.kinds import VEHICLES
from scenes.recordings import recording
from scenes.stage import Plane, light_of

LIGHT = Light(45.0, 200.0)
RED, AMBER, GREEN = 1, 2, 3
"""Slots of signal heads."""
REAR_LAMPS = 2
"""Slot of vehicles."""


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(Plane(models=library()))


def towards(x: float, y: float, z: float, *, from_yaw_rad: float, distance_m: float) -> View:
    """A level view of a point, from a direction."""
    place = (x + distance_m * cos(from_yaw_rad), y + distance_m * sin(from_yaw_rad), z)
    return look(place, yaw_rad=from_yaw_rad + pi, pitch_rad=0.0, size_px=(240, 180), vertical_fov_rad=0.5)


def change(renderer: Renderer, view: View, off: Instance, on: Instance) -> np.ndarray:
    """(height, width, 3) by how much the picture of one thing gets brighter [kcd/m²]."""
    before, after = (
        light_of(renderer, view, instances=[each], light=LIGHT, truth=False).radiance[..., :3].astype(float)
        for each in (off, on)
    )
    return np.asarray(after - before)


def lamp_px(view: View, instance: Instance, slot: int) -> np.ndarray:
    """(height, width) where a slot's triangles lie in the picture, and a pixel around them."""
    mesh = library()[instance.model].parts[instance.part]
    assert mesh.surface is not None
    mine = mesh.indices[(mesh.surface[mesh.indices, 2] == slot).any(axis=1)]
    corners = mesh.positions[mine].astype(float) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
    shapes = shapely.buffer(shapely.polygons(view.project(corners)), 1.0, quad_segs=2)
    width, height = view.size_px
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.asarray(shapely.contains_xy(shapely.union_all(shapes), columns, rows))


# Vehicles.


def vehicle(kind: str, braking: bool) -> Instance:
    """A vehicle of a recording, at the origin, heading east."""
    made = recording([kind], lambda _, t: (0.0, 0.0, 0.0, 12.0 - (2.0 * t if braking else 0.0)), frames=8)
    (drawn,) = Actors(made, seed=0, models=library(), ground=lambda xy: np.zeros(len(xy))).at(1.2)
    return drawn


@pytest.mark.parametrize("kind", VEHICLES, ids=lambda kind: kind.name)
def test_brake_lamps_light_up_at_the_rear_and_nowhere_else(renderer: Renderer, kind) -> None:
    off, on = vehicle(kind.name, False), vehicle(kind.name, True)
    behind = towards(-kind.length_m / 2, 0, kind.height_m / 2, from_yaw_rad=pi, distance_m=6.0)
    brighter, lamp = change(renderer, behind, off, on), lamp_px(behind, off, REAR_LAMPS)
    lit = brighter[..., 0] > 0
    assert lit.sum() >= 12
    assert not (brighter.any(axis=2) & ~lamp).any()
    # What is seen of them is red, and bright beside sunlit paint: white paper in full sun sends 32 kcd/m².
    assert brighter[lit][:, 0].mean() > 5.0
    assert brighter[lit][:, 0].mean() > 5 * brighter[lit][:, 1:].mean()
    # As much on the left as on the right.
    sides = [lit[:, :120].sum(), lit[:, 120:].sum()]
    assert min(sides) > 0.6 * max(sides)
    ahead = towards(kind.length_m / 2, 0, kind.height_m / 2, from_yaw_rad=0.0, distance_m=6.0)
    assert not change(renderer, ahead, off, on).any()


# Signals.


@dataclass(frozen=True)
class Signals:
    """A controller's states, a letter every half second."""

    letters: str
    step_s: float = 0.5

    @property
    def signals(self) -> dict[str, tuple[tuple[int, str], ...]]:
        return {"c": tuple((step, letter) for step, letter in enumerate(self.letters))}


SHOWN = {"r": {RED}, "u": {RED, AMBER}, "y": {AMBER}, "g": {GREEN}, "G": {GREEN}, "O": set()}
COLOURS = {RED: [True, False], AMBER: [True, True], GREEN: [False, True]}
"""Which of a lamp's red and green are bright."""


@pytest.mark.parametrize(("model", "letters"), [(FOR_VEHICLES, "ruGyg"), (WALKERS, "rG")])
def test_a_head_shows_its_links_letter(renderer: Renderer, model: str, letters: str) -> None:
    head = Head(model, upright(0.0, 0.0, pi, z_m=3.0), "c", 0)
    (off,) = instances([head], None, 0.0)
    view, back = (towards(0, 0, 3.0, from_yaw_rad=yaw, distance_m=3.0) for yaw in (pi, 0.0))
    for step, letter in enumerate(letters):
        (on,) = instances([head], Signals(letters), 0.5 * step + 0.1)  # type: ignore[arg-type]
        brighter = change(renderer, view, off, on)
        expected = {slot: lamp_px(view, off, slot) for slot in SHOWN[letter]}
        assert not (brighter.any(axis=2) & ~np.logical_or.reduce(list(expected.values()))).any()
        for slot, where in expected.items():
            lit = brighter[where & brighter.any(axis=2)]
            assert len(lit) > 0.4 * where.sum() > 40
            assert (lit.mean(axis=0)[:2] > 0.25 * lit.mean(axis=0).max()).tolist() == COLOURS[slot]
        assert not change(renderer, back, off, on).any()
