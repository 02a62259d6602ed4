"""Heads of street lights and signals, without the masts and arms that carry them.

A head is in the frame of its holder: `lamp_head` reaches out along x from the end of an arm at the origin and shines
down; signal heads look along x, their housing's back at x = 0 and its middle at y = z = 0.
"""

from typing import Final

import numpy as np

from assets.models.common import Floats, Model, Part, model, part
from assets.models.shapes import box, lathe, loft, rounded_rectangle

LENS_M: Final = {"signal_head": 0.150, "signal_pedestrian": 0.100}
"""Radius of the lenses: EN 12368, 300 and 200 mm."""
DEPTH_M: Final = 0.16


@model("lamp_head")
def lamp_head() -> Model:
    """An LED luminaire for streets, 0.62 × 0.28 × 0.10 m: spigot, ribbed housing, glass below."""
    made = Model("lamp_head")
    stations = [
        (0.10, 0.045, 0.032),
        (0.15, 0.095, 0.040),
        (0.24, 0.135, 0.042),
        (0.50, 0.138, 0.036),
        (0.60, 0.115, 0.026),
    ]
    rings = [_section(x, half, high) for x, half, high in stations] + [_section(0.62, 0.09, 0.012)]
    made.add(loft("mast", rings, smooth_deg=50.0, caps=True))
    made.add(lathe("mast", [(0.0, 0.0), (0.036, 0.001), (0.036, 0.14)], 10, axis=0))
    made.add(box("lens", (0.25, -0.105, -0.036), (0.57, 0.105, -0.026)))
    for i in range(5):
        x = 0.27 + 0.045 * i
        made.add(box("mast", (x, -0.09, 0.030), (x + 0.008, 0.09, 0.052)))
    return made


def _section(x: float, half: float, high: float) -> Floats:
    """A luminaire's outline at x: flat below, arched above; counter-clockwise seen from +x."""
    turn = np.linspace(0.0, np.pi, 7)
    arch = np.stack([half * np.cos(turn), high * np.sin(turn) ** 0.7], axis=1)
    outline = np.concatenate([arch, [(-half, -0.026), (half, -0.026)]])
    return np.column_stack([np.full(len(outline), x), outline])


@model("signal_head")
def signal_head() -> Model:
    """Three lenses of 300 mm with visors, red above."""
    return _signal("signal_head", ("lamp_red", "lamp_amber", "lamp_green"))


@model("signal_pedestrian")
def signal_pedestrian() -> Model:
    """Two lenses of 200 mm with visors, red above."""
    return _signal("signal_pedestrian", ("lamp_red", "lamp_green"))


def _signal(name: str, lamps: tuple[str, ...]) -> Model:
    radius = LENS_M[name]
    pitch = 2.0 * radius + 0.045
    made = Model(name)
    for i, lamp in enumerate(lamps):
        z = pitch * ((len(lamps) - 1) / 2.0 - i)
        outline = rounded_rectangle(radius + 0.022, pitch / 2.0 - 0.004, 0.04, 3)
        rings = [
            _plate(outline * s, x, z) for x, s in ((0.0, 0.94), (0.015, 1.0), (DEPTH_M - 0.01, 1.0), (DEPTH_M, 0.97))
        ]
        made.add(loft("housing", rings, smooth_deg=40.0, caps=True))
        dome = [(radius * np.cos(t), DEPTH_M + 0.002 + 0.22 * radius * np.sin(t)) for t in np.linspace(0.0, 1.57, 4)]
        made.add(lathe(lamp, dome, 20, axis=0, smooth_deg=80.0).moved((0.0, 0.0, z)))
        made.add(*_visor(radius + 0.008, z))
    half = pitch * len(lamps) / 2.0
    made.add(box("housing", (0.01, -0.05, -half - 0.02), (0.10, 0.05, half + 0.02), 0.01))
    return made


def _plate(outline: Floats, x: float, z: float) -> Floats:
    """An outline (n, 2) in y and z at x."""
    return np.column_stack([np.full(len(outline), x), outline[:, 0], outline[:, 1] + z])


def _visor(radius: float, z: float) -> list[Part]:
    """A cowl over a lens: three quarters of a cylinder, longer above, seen from both sides."""
    turn = np.radians(np.linspace(-38.0, 218.0, 15))
    reach = DEPTH_M + radius * (0.55 + 1.15 * np.clip(0.5 + 0.5 * np.sin(turn), 0.0, 1.0))
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn) + z], axis=1)
    root = np.column_stack([np.full(len(turn), DEPTH_M - 0.01), rim])
    lip = np.column_stack([reach, rim])
    thin = (rim - (0.0, z)) * 0.985 + (0.0, z)
    inner_root, inner_lip = np.column_stack([root[:, 0], thin]), np.column_stack([lip[:, 0], thin])
    n = len(turn)
    quads = [(i, i + 1, n + i + 1, n + i) for i in range(n - 1)]
    outside = part("housing", np.concatenate([root, lip]), quads)
    inside = part("housing", np.concatenate([inner_root, inner_lip]), [quad[::-1] for quad in quads])
    edge = part("housing", np.concatenate([lip, inner_lip]), quads)
    return [outside, inside, edge]
