"""The UAV: a camera quadrotor of the size of a DJI Phantom 4, 350 mm from motor to motor across.

Size: DJI Phantom 4 user manual: 350 mm diagonal without propellers, propellers 9450 of 24 cm. The body is drawn ten
times as big and shrunk, for the implicit surfaces' tolerances are a car's.
"""

import numpy as np

from assets.models.car_build import PAINT, PLASTIC, TRIM, gate, skin_parts
from assets.models.common import Floats, Model, Part, model, part
from assets.models.fields import smooth_max, smooth_min
from assets.models.implicit import mesh
from assets.models.shapes import box, ellipsoid, lathe, tube
from assets.models.simplify import simplify

ARM_M = 0.35 / np.sqrt(8.0)
"""x and y of the motors."""
PROPELLER_M = 0.12
"""Radius of the propellers."""
MIDDLE_Z = 1.36
"""Height of the shell's middle, in decimetres."""


def shell_field(p: Floats) -> Floats:
    """The shell at ten times its size: a flat round body and four arms that taper to the motors."""
    x, y, z = np.abs(p[:, 0]), np.abs(p[:, 1]), p[:, 2] - MIDDLE_Z
    body = (np.sqrt((p[:, 0] / 0.98) ** 2 + (y / 0.80) ** 2 + (z / 0.40) ** 2 + 1e-9) - 1.0) * 0.40
    end = 10.0 * ARM_M
    along = np.clip((x + y) / (2.0 * end), 0.0, 1.0)
    middle = along * end
    away = np.sqrt((x - middle) ** 2 + (y - middle) ** 2 + ((z - 0.05 + 0.06 * along) * 1.15) ** 2 + 1e-9)
    arm = away - (0.27 - 0.10 * along)
    pod = smooth_max(np.hypot(x - end, y - end) - 0.185, np.abs(z - 0.02) - 0.17, 0.12)
    return smooth_min(smooth_min(body, arm, 0.35), pod, 0.10)


def _battery(p: Floats) -> Floats:
    """The battery's outline at the rear."""
    return gate(np.abs(p[:, 1]) - 0.36, np.abs(p[:, 2] - MIDDLE_Z - 0.02) - 0.2, p[:, 0] + 0.6)


def shell() -> list[Part]:
    """The white shell: grey bands along its sides, dark sensors, the battery's seam."""
    skin = mesh(shell_field, np.array([-1.7, -1.7, 0.7]), np.array([1.7, 1.7, 2.0]), 0.05, 3600)
    skin.paint(lambda p: np.abs(p[:, 2] - MIDDLE_Z + 0.10) - 0.012, TRIM)
    skin.paint(lambda p: gate(np.hypot(np.abs(p[:, 1]) - 0.30, p[:, 2] - MIDDLE_Z) - 0.085, 0.5 - p[:, 0]), TRIM)
    skin.paint(_battery, TRIM)
    skin.paint(lambda p: _battery(p) + 0.02, PAINT)
    skin.paint(lambda p: np.maximum(np.hypot(p[:, 1], p[:, 2] - MIDDLE_Z - 0.02) - 0.09, p[:, 0] + 0.6), PLASTIC)
    simplify(skin, 0.006, 1.0)
    parts = [one.turned(0.1 * np.eye(3)) for one in skin_parts(skin)]
    return [
        Part("shell", one.vertices, one.triangles, one.normals, one.tint) if one.material == "paint" else one
        for one in parts
    ]


def propeller(turn_deg: float, mirror: float) -> list[Part]:
    """Two thin twisted blades about the origin and their hub."""
    stations = [
        (0.010, 0.010, 0.004),
        (0.030, 0.024, 0.007),
        (0.065, 0.020, 0.004),
        (0.105, 0.013, 0.002),
        (PROPELLER_M, 0.005, 0.001),
    ]
    rows = [[(r, mirror * 0.35 * w, lift), (r, -mirror * 0.65 * w, -lift)] for r, w, lift in stations]
    points = np.array(rows).reshape(-1, 3)
    quads = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(stations) - 1)]
    faces = [*quads, *(quad[::-1] for quad in quads)]
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    blades = [part("shell", points @ (turn * sign).T * (1, 1, sign), faces, 60.0) for sign in (1.0, -1.0)]
    return [*blades, lathe("metal", [(0.008, -0.004), (0.009, 0.004), (0.005, 0.009), (1e-4, 0.010)], 10)]


def motors() -> list[Part]:
    """Motors with their propellers, and the lights below them: red in front, amber behind."""
    parts: list[Part] = []
    bell = lathe("metal", [(0.013, 0.0), (0.0145, 0.006), (0.0145, 0.020), (0.011, 0.026), (1e-4, 0.027)], 14)
    for index, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        spot = np.array([sx * ARM_M, sy * ARM_M, 0.0])
        parts.append(bell.moved(spot + (0.0, 0.0, 0.152)))
        parts += [
            one.moved(spot + (0.0, 0.0, 0.186)) for one in propeller(25.0 + 80.0 * index, 1.0 if index % 2 else -1.0)
        ]
        lamp = "lamp_rear" if sx > 0 else "lamp_indicator"
        parts.append(ellipsoid(lamp, (*spot[:2], 0.118), (0.008, 0.008, 0.005), 5, 8))
    return parts


def landing_gear() -> list[Part]:
    """Two skids on bent legs, one on either side."""
    y0, y1 = 0.052, 0.088
    leg = [(0.050, y0, 0.118), (0.056, y0 + 0.016, 0.085), (0.060, y1 - 0.004, 0.030), (0.055, y1, 0.008)]
    back = [(-x, y, z) for x, y, z in leg]
    bar = [(0.068, y1, 0.008), (0.03, y1, 0.006), (-0.03, y1, 0.006), (-0.068, y1, 0.008)]
    left = [tube("shell", one, [0.008, 0.0065, 0.0055, 0.0055], 7) for one in (leg, back)]
    left.append(tube("shell", bar, 0.006, 7))
    return left + [one.mirrored() for one in left]


def camera() -> list[Part]:
    """The camera on its gimbal below the nose, looking straight down as it flies over a road."""
    parts = [
        box("plastic", (0.005, -0.030, 0.088), (0.065, 0.030, 0.100), 0.004),
        tube("metal", [(0.035, 0.0, 0.09), (0.035, 0.0, 0.072)], 0.012, 10),
    ]
    parts.append(tube("metal", [(0.035, 0.0, 0.072), (0.020, 0.026, 0.072), (0.030, 0.030, 0.055)], 0.006, 6))
    parts.append(box("metal", (0.012, -0.022, 0.040), (0.056, 0.022, 0.068), 0.006))
    for material, radius, low in (("trim", 0.014, 0.030), ("glass", 0.010, 0.0295)):
        parts.append(lathe(material, [(1e-4, low), (radius, low), (radius, 0.041)], 14).moved((0.034, 0.0, 0.0)))
    return parts


@model("quadrotor")
def quadrotor() -> Model:
    """The UAV, standing on its skids at z = 0."""
    made = Model("quadrotor")
    made.add(*shell(), *motors(), *landing_gear(), *camera())
    return made
