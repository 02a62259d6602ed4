"""A motorcycle without fairing and its rider, of 2.2 m."""

from typing import Final

import numpy as np

from assets.models.common import Model, Part, model, part
from assets.models.finish import fit
from assets.models.shapes import box, ellipsoid, lathe, loft, rounded_rectangle, tube
from assets.models.wheels import disc

FRONT, REAR, WHEEL_M = 0.78, -0.72, 0.305

LEAN_DEG: Final = 10.0
"""How far a parked motorcycle leans on its side stand, to its left. Ours."""


def wheel(x: float, width: float) -> list[Part]:
    """A narrow wheel with a round tyre, ten spokes and brake discs."""
    r, rim = WHEEL_M, 0.70 * WHEEL_M
    half = width / 2.0
    tyre = [(rim, -0.5 * half), (rim + 0.03, -half), (r - 0.03, -0.9 * half), (r, 0.0), (r - 0.03, 0.9 * half),
            (rim + 0.03, half), (rim, 0.5 * half)]  # fmt: skip
    parts = [lathe("tyre", tyre, 24, axis=1, smooth_deg=70.0)]
    parts.append(lathe("trim", [(rim, 0.5 * half), (rim - 0.02, 0.0), (rim, -0.5 * half)], 24, axis=1, smooth_deg=80.0))
    for k in range(5):
        angle = 2.0 * np.pi * k / 5.0
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        parts.append(tube("trim", [0.03 * out, (rim - 0.01) * out], [0.018, 0.011], 5))
    side = disc("metal", 0.13, 0.05, 16)
    parts += [side, side.mirrored(), lathe("metal", [(0.03, -0.09), (0.03, 0.09)], 8, axis=1)]
    return [one.moved((x, 0.0, r)) for one in parts]


def stretched(material: str, stations: list[tuple[float, float, float, float]], radius: float = 0.7) -> Part:
    """A body along x through stations of (x, z of its middle, half width, half height), its edges round."""
    rings = []
    for x, z, wide, high in stations:
        outline = rounded_rectangle(wide, high, radius * min(wide, high), 3)
        rings.append(np.column_stack([np.full(len(outline), x), outline[:, 0], outline[:, 1] + z]))
    return loft(material, rings, 60.0, caps=True)


def guard(x: float, start_deg: float, end_deg: float, half: float, material: str) -> Part:
    """A mudguard about a wheel, from one angle to another."""
    angle = np.radians(np.linspace(start_deg, end_deg, 9))
    rings = []
    for y, radius in (
        (half, WHEEL_M + 0.01),
        (0.7 * half, WHEEL_M + 0.035),
        (-0.7 * half, WHEEL_M + 0.035),
        (-half, WHEEL_M + 0.01),
    ):
        rings.append(np.stack([x + radius * np.cos(angle), np.full(9, y), WHEEL_M + radius * np.sin(angle)], axis=1))
    return loft(material, rings, 60.0, closed=False)


def machine() -> list[Part]:
    """The motorcycle alone."""
    parts = [
        *wheel(FRONT, 0.11),
        *wheel(REAR, 0.15),
        guard(FRONT, 20.0, 150.0, 0.07, "paint"),
        guard(REAR, 60.0, 175.0, 0.085, "trim"),
    ]
    parts.append(
        stretched(
            "paint",
            [
                (0.40, 0.86, 0.03, 0.04),
                (0.36, 0.87, 0.11, 0.10),
                (0.22, 0.88, 0.16, 0.12),
                (0.02, 0.86, 0.13, 0.10),
                (-0.12, 0.82, 0.07, 0.05),
            ][::-1],
        )
    )
    parts.append(
        stretched(
            "trim",
            [
                (-0.68, 0.87, 0.10, 0.03),
                (-0.45, 0.83, 0.14, 0.04),
                (-0.20, 0.80, 0.13, 0.04),
                (-0.04, 0.82, 0.06, 0.03),
            ],
        )
    )
    parts.append(
        stretched(
            "paint",
            [
                (-1.00, 0.86, 0.03, 0.02),
                (-0.90, 0.85, 0.07, 0.04),
                (-0.60, 0.79, 0.11, 0.05),
                (-0.15, 0.72, 0.10, 0.05),
            ],
        )
    )
    parts.append(box("lamp_rear", (-1.03, -0.05, 0.83), (-0.98, 0.05, 0.87), 0.012))
    parts.append(tube("trim", [(-0.85, 0.0, 0.80), (-1.05, 0.0, 0.62)], 0.02, 5))
    parts.append(
        part(
            "plate",
            [(-1.075, 0.09, 0.55), (-1.075, -0.09, 0.55), (-1.045, -0.09, 0.68), (-1.045, 0.09, 0.68)],
            [(0, 3, 2, 1)],
        )
    )
    parts += [
        box("metal", (-0.18, -0.17, 0.30), (0.28, 0.17, 0.58), 0.06),
        box("plastic", (-0.10, -0.13, 0.55), (0.22, 0.13, 0.76), 0.04),
    ]
    parts.append(
        tube("metal", [(0.26, 0.05, 0.42), (0.38, 0.06, 0.34), (0.20, 0.10, 0.20), (-0.20, -0.13, 0.24)], 0.026, 6)
    )
    parts.append(
        tube("chrome", [(-0.20, -0.16, 0.28), (-0.40, -0.19, 0.34), (-0.92, -0.20, 0.50)], [0.035, 0.055, 0.052], 10)
    )
    for y in (-0.105, 0.105):
        parts.append(tube("metal", [(FRONT, y, WHEEL_M), (0.46, y, 1.00)], 0.026, 7))
        parts.append(tube("trim", [(REAR, y, WHEEL_M), (-0.10, 0.9 * y, 0.40)], 0.028, 6))
        parts.append(tube("trim", [(0.44, 0.4 * y, 0.92), (0.1, y, 0.72), (-0.2, y, 0.50)], 0.024, 6))
        parts.append(box("lamp_indicator", (0.50, 1.9 * y - 0.03, 0.82), (0.55, 1.9 * y + 0.03, 0.86), 0.01))
    parts.append(
        tube(
            "trim",
            [
                (0.28, 0.40, 1.02),
                (0.36, 0.28, 1.05),
                (0.44, 0.10, 1.03),
                (0.44, -0.10, 1.03),
                (0.36, -0.28, 1.05),
                (0.28, -0.40, 1.02),
            ],
            0.014,
            6,
        )
    )
    parts += [
        ellipsoid("trim", (0.54, 0.0, 0.90), (0.10, 0.10, 0.11)),
        ellipsoid("lamp_front", (0.60, 0.0, 0.90), (0.055, 0.085, 0.09)),
    ]
    parts.append(box("trim", (0.40, -0.08, 1.02), (0.50, 0.08, 1.06), 0.015))
    for side in (-1.0, 1.0):
        parts.append(tube("trim", [(0.34, side * 0.30, 1.05), (0.36, side * 0.36, 1.20)], 0.008, 4))
        parts.append(ellipsoid("trim", (0.36, side * 0.385, 1.22), (0.018, 0.06, 0.038), 6, 10))
    return parts


def rider() -> list[Part]:
    """A rider with jacket, trousers, boots and a helmet, leaning forward to the bars."""
    spine = [(-0.30, 0.0, 0.84), (-0.27, 0.0, 0.98), (-0.18, 0.0, 1.12), (-0.06, 0.0, 1.24), (0.02, 0.0, 1.31)]
    rings = []
    for (x, _, z), wide, deep in zip(
        spine, (0.16, 0.165, 0.19, 0.205, 0.09), (0.12, 0.115, 0.125, 0.12, 0.07), strict=True
    ):
        outline = rounded_rectangle(wide, deep, 0.85 * deep, 3)
        lean = np.array([0.62, 0.0, 0.78])
        across = np.stack([outline[:, 1] * lean[2], -outline[:, 0], -outline[:, 1] * lean[0]], axis=1)
        rings.append(across + (x, 0.0, z))
    parts = [loft("leather", rings, 70.0, caps=True)]
    for side in (-1.0, 1.0):
        shoulder, elbow, hand = (-0.03, side * 0.19, 1.26), (0.06, side * 0.40, 1.08), (0.28, side * 0.365, 1.03)
        upper = [
            (-0.05, side * 0.12, 1.27),
            shoulder,
            (0.02, side * 0.31, 1.16),
            elbow,
            (0.17, side * 0.39, 1.04),
            (0.25, side * 0.37, 1.03),
        ]
        parts.append(tube("leather", upper, [0.06, 0.078, 0.064, 0.054, 0.046, 0.038], 9))
        parts.append(ellipsoid("shoes", hand, (0.055, 0.05, 0.04), 6, 9))
        leg = [
            (-0.30, side * 0.08, 0.84),
            (-0.16, side * 0.15, 0.86),
            (0.04, side * 0.21, 0.80),
            (0.16, side * 0.23, 0.73),
            (0.10, side * 0.225, 0.60),
            (0.00, side * 0.22, 0.42),
        ]
        parts.append(tube("denim", leg, [0.10, 0.098, 0.082, 0.074, 0.064, 0.052], 9))
        parts.append(
            tube(
                "shoes",
                [
                    (-0.01, side * 0.22, 0.46),
                    (-0.03, side * 0.22, 0.36),
                    (0.02, side * 0.22, 0.31),
                    (0.15, side * 0.22, 0.30),
                ],
                [0.056, 0.056, 0.056, 0.03],
                8,
            )
        )
        parts.append(tube("metal", [(-0.02, side * 0.12, 0.27), (0.0, side * 0.27, 0.27)], 0.014, 5))
    parts.append(ellipsoid("shell", (0.10, 0.0, 1.365), (0.155, 0.125, 0.135), 10, 16, 12.0))
    parts.append(ellipsoid("glass", (0.155, 0.0, 1.36), (0.112, 0.112, 0.070), 8, 14, 12.0))
    parts.append(ellipsoid("trim", (0.06, 0.0, 1.28), (0.09, 0.085, 0.06), 6, 12))
    return parts


def side_stand() -> list[Part]:
    """On the left, from the frame to the ground beside it: at `LEAN_DEG` its foot touches."""
    foot_y = 0.30
    foot = (-0.16, foot_y, foot_y * np.tan(np.radians(LEAN_DEG)))
    return [
        tube("metal", [(-0.06, 0.13, 0.28), foot], 0.013, 6),
        box("metal", (foot[0] - 0.05, foot_y - 0.03, foot[2]), (foot[0] + 0.05, foot_y + 0.03, foot[2] + 0.015), 0.006),
    ]


def ridden() -> Model:
    """A motorcycle with its rider as drawn, before it is fitted to its size."""
    made = Model("motorcycle")
    made.add(*machine(), *rider())
    return made


@model("motorcycle")
def motorcycle() -> Model:
    """A motorcycle with its rider."""
    return fit(ridden(), mirrors_above=1.0)


@model("motorcycle_parked")
def motorcycle_parked() -> Model:
    """The same without its rider, upright, its side stand out: a scene leans it on that by `lean_deg`."""
    made = Model("motorcycle_parked", extras={"lean_deg": LEAN_DEG})
    made.add(*machine(), *side_stand())
    return fit(made, mirrors_above=1.0, whole=ridden())
