"""Small things beside the road: bench, bin, bollard, hydrant, bicycle stand, a parked bicycle, a metre of hedge."""

import numpy as np

from assets.models.common import Floats, Model, Part, model
from assets.models.rings import unit
from assets.models.shapes import box, lathe, tube

HEDGE_LEAVES = 1300


@model("bench")
def bench() -> Model:
    """A bench of 1.80 m with a back; one sits looking along x."""
    made = Model("bench")
    for i in range(4):
        x = -0.16 + 0.115 * i
        made.add(box("wood", (x, -0.90, 0.425), (x + 0.095, 0.90, 0.46), 0.006, tint=0.92 + 0.04 * (i % 3)))
    lean = np.radians(14.0)
    for i in range(3):
        z = 0.53 + 0.115 * i
        x = -0.20 - (z - 0.46) * np.tan(lean)
        made.add(box("wood", (x - 0.032, -0.90, z), (x, 0.90, z + 0.095), 0.006, tint=0.95 - 0.04 * (i % 2)))
    for y in (-0.72, 0.72):
        made.add(tube("cast_iron", [(0.26, y, 0.41), (-0.18, y, 0.41), (-0.33, y, 0.86)], 0.022, 6))
        made.add(tube("cast_iron", [(0.22, y, 0.0), (0.20, y, 0.41)], 0.022, 6))
        made.add(tube("cast_iron", [(-0.22, y, 0.0), (-0.16, y, 0.41)], 0.022, 6))
        made.add(box("cast_iron", (-0.27, y - 0.03, 0.0), (0.27, y + 0.03, 0.015)))
        made.add(tube("cast_iron", [(-0.24, y, 0.62), (0.20, y, 0.64), (0.24, y, 0.42)], 0.018, 6))
    return made


@model("bin")
def litter_bin() -> Model:
    """A litter bin, 0.46 m across and 0.95 m high: slatted drum under a hood with an opening."""
    made = Model("bin")
    made.add(
        lathe("cast_iron", [(0.0, 0.03), (0.20, 0.03), (0.205, 0.72), (0.19, 0.73), (0.185, 0.40), (0.0, 0.40)], 20)
    )
    for k in range(20):
        angle = 2.0 * np.pi * k / 20
        turn = np.array([(np.cos(angle), -np.sin(angle), 0.0), (np.sin(angle), np.cos(angle), 0.0), (0.0, 0.0, 1.0)])
        made.add(box("cast_iron", (0.205, -0.024, 0.06), (0.222, 0.024, 0.71)).turned(turn))
    made.add(lathe("cast_iron", [(0.16, 0.0), (0.17, 0.03)], 16))
    for k in range(4):
        angle = np.pi / 4.0 + np.pi / 2.0 * k
        x, y = 0.19 * np.cos(angle), 0.19 * np.sin(angle)
        made.add(tube("cast_iron", [(x, y, 0.70), (x, y, 0.88)], 0.012, 5))
    made.add(lathe("cast_iron", [(0.22, 0.865), (0.23, 0.885), (0.15, 0.935), (0.0, 0.95)], 20, smooth_deg=40.0))
    made.add(lathe("cast_iron", [(0.0, 0.866), (0.22, 0.865)], 20))
    return made


@model("bollard")
def bollard() -> Model:
    """A cast bollard, 0.14 m thick and 1.0 m high, with a white band."""
    made = Model("bollard")
    made.add(lathe("cast_iron", [(0.085, 0.0), (0.085, 0.03), (0.066, 0.09), (0.060, 0.80)], 14))
    made.add(lathe("sign_white", [(0.061, 0.80), (0.061, 0.88)], 14))
    made.add(
        lathe(
            "cast_iron", [(0.060, 0.88), (0.070, 0.90), (0.070, 0.93), (0.052, 0.975), (0.0, 1.0)], 14, smooth_deg=40.0
        )
    )
    return made


@model("hydrant")
def hydrant() -> Model:
    """A pillar hydrant, 0.80 m high, one large and two small outlets."""
    made = Model("hydrant")
    body = [(0.15, 0.0), (0.15, 0.04), (0.105, 0.05), (0.10, 0.50), (0.13, 0.51), (0.13, 0.55), (0.115, 0.56)]
    dome = [(0.115, 0.62), (0.10, 0.69), (0.06, 0.735), (0.035, 0.745), (0.03, 0.80), (0.0, 0.80)]
    made.add(lathe("signal_paint", body + dome, 16, smooth_deg=40.0))
    nozzle = [(0.055, 0.09), (0.055, 0.16), (0.066, 0.165), (0.066, 0.195), (0.0, 0.20)]
    made.add(lathe("signal_paint", nozzle, 12, axis=0).moved((0.0, 0.0, 0.40)))
    side = lathe("signal_paint", [(r * 0.75, h) for r, h in nozzle], 10, axis=1).moved((0.0, 0.0, 0.42))
    made.add_both_sides(side)
    return made


@model("bicycle_stand")
def bicycle_stand() -> Model:
    """A Sheffield stand: a bent steel tube of 48 mm, 0.75 m along x, 0.80 m high."""
    made = Model("bicycle_stand")
    turn = np.radians(np.linspace(90.0, 0.0, 5))
    corner = [(0.235 + 0.14 * np.cos(t), 0.0, 0.636 + 0.14 * np.sin(t)) for t in turn]
    path = [(-x, y, z) for x, y, z in reversed(corner)] + corner
    made.add(tube("metal", [(-0.375, 0.0, 0.0), *path, (0.375, 0.0, 0.0)], 0.024, 8))
    for x in (-0.375, 0.375):
        made.add(lathe("metal", [(0.0, 0.008), (0.055, 0.008), (0.06, 0.0)][::-1], 10).moved((x, 0.0, 0.0)))
    return made


@model("bicycle")
def bicycle() -> Model:
    """A town bicycle of 1.75 m without a rider, upright."""
    made = Model("bicycle")
    rear, front, radius = np.array([-0.53, 0.0, 0.345]), np.array([0.53, 0.0, 0.345]), 0.345
    for hub in (rear, front):
        made.add(*_wheel(hub, radius))
    crank, seat, head = (-0.08, 0.0, 0.29), (-0.22, 0.0, 0.80), (0.36, 0.0, 0.84)
    low_head = (0.40, 0.0, 0.70)
    for line, thick in (
        ((crank, seat), 0.017), ((crank, low_head), 0.019), ((seat, (0.35, 0.0, 0.80)), 0.016),
        (((0.33, 0.0, 0.94), (0.41, 0.0, 0.66)), 0.018),
    ):  # fmt: skip
        made.add(tube("paint", line, thick, 6))
    for y in (-0.045, 0.045):
        made.add(tube("paint", [crank, (-0.53, y, 0.345), (-0.235, y * 0.4, 0.76)], 0.009, 4))
        made.add(tube("metal", [(0.41, y * 0.9, 0.67), (0.53, y, 0.345)], 0.011, 4))
        made.add(tube("plastic", [(0.23, 6.8 * y, 0.99), (0.13, 6.8 * y, 0.98)], 0.016, 6))
        pedal = (-0.08 + np.sign(y) * 0.16, y * 2.6, 0.29 - np.sign(y) * 0.04)
        made.add(tube("metal", [(-0.08, y * 1.6, 0.29), (pedal[0], y * 1.8, pedal[2])], 0.010, 4))
        made.add(box("plastic", (-0.04, -0.045, -0.01), (0.04, 0.045, 0.012)).moved(pedal))
    bar = [
        (0.20, -0.31, 0.985),
        (0.30, -0.20, 1.0),
        (head[0] - 0.01, 0.0, 0.98),
        (0.30, 0.20, 1.0),
        (0.20, 0.31, 0.985),
    ]
    made.add(tube("metal", bar, 0.012, 5), tube("metal", [(0.33, 0.0, 0.94), (0.345, 0.0, 0.98)], 0.012, 5))
    made.add(tube("metal", [seat, (-0.25, 0.0, 0.93)], 0.013, 5))
    saddle = [(-0.39, 0.0, 0.01), (-0.34, 0.0, 0.03), (-0.26, 0.0, 0.01), (-0.14, 0.0, 0.0), (-0.10, 0.0, -0.01)]
    flat = np.diag([1.0, 1.0, 0.45])
    made.add(tube("plastic", saddle, [0.035, 0.075, 0.055, 0.028, 0.016], 8).turned(flat).moved((0.0, 0.0, 0.95)))
    made.add(tube("metal", [(-0.75, 0.0, 0.71), (-0.26, 0.0, 0.72)], 0.010, 4))
    made.add(box("metal", (-0.74, -0.06, 0.715), (-0.32, 0.06, 0.725)))
    return made


def _wheel(hub: Floats, radius: float) -> list[Part]:
    """Tyre, rim and spokes about the y axis."""
    turn = np.linspace(0.0, 2.0 * np.pi, 21)[:-1]
    parts = []
    for material, mean, half, width in (("tyre", radius - 0.019, 0.019, 0.019), ("rim", radius - 0.045, 0.010, 0.012)):
        section = [
            (mean + half * np.sin(t), width * -np.cos(t)) for t in np.radians([0.0, 72.0, 144.0, 216.0, 288.0, 360.0])
        ]
        parts.append(lathe(material, section, len(turn), axis=1, smooth_deg=80.0).moved(hub.tolist()))
    for k in range(9):
        angle = np.pi * k / 9.0
        out = np.array([np.cos(angle), 0.0, np.sin(angle)]) * (radius - 0.045)
        side = np.array([0.0, 0.02 * (-1) ** k, 0.0])
        spoke = np.array([hub - out, hub + side, hub + out]).tolist()
        parts.append(tube("chrome", spoke, 0.0018, 3))
    return parts


@model("hedge")
def hedge() -> Model:
    """A metre of clipped hedge along x, 0.60 m thick and 0.95 m high, that joins its like end to end."""
    rng = np.random.default_rng(21)
    made = Model("hedge", reach_m=0.0)
    size = np.array([1.0, 0.60, 0.95])
    # Leaves on top and both flanks by area, some deeper; ends run on into the next piece.
    face = rng.choice(3, HEDGE_LEAVES, p=[0.40, 0.30, 0.30])
    u = rng.random((HEDGE_LEAVES, 2))
    deep = 0.10 * rng.random(HEDGE_LEAVES) ** 2.0
    points = np.column_stack([(u[:, 0] - 0.5) * size[0], (u[:, 1] - 0.5) * size[1], size[2] - 0.05 - deep])
    outward = np.tile([0.0, 0.0, 1.0], (HEDGE_LEAVES, 1))
    for side, sign in ((1, 1.0), (2, -1.0)):
        flank = face == side
        points[flank, 1] = sign * (size[1] / 2.0 - 0.04 - deep[flank])
        points[flank, 2] = u[flank, 1] * (size[2] - 0.06) + 0.03
        outward[flank] = (0.0, sign, 0.0)
    points += 0.018 * np.sin(9.0 * points[:, [1, 2, 0]] + 2.0)
    out = unit(outward + 0.75 * rng.standard_normal((HEDGE_LEAVES, 3)))
    along = unit(np.cross(out, rng.standard_normal((HEDGE_LEAVES, 3))))
    across = np.cross(out, along)
    half = rng.uniform(0.028, 0.060, (HEDGE_LEAVES, 1))
    corners = np.stack(
        [
            points + half * along,
            points + half * (0.7 * across - 0.5 * along),
            points - half * (0.7 * across + 0.5 * along),
        ],
        axis=1,
    ).reshape(-1, 3)
    corners = np.clip(corners, (-0.5 * size[0], -0.5 * size[1], 0.0), (0.5 * size[0], 0.5 * size[1], size[2]))
    light = (0.45 + 0.65 * points[:, 2] / size[2]) * (1.0 - 4.0 * deep) * rng.uniform(0.55, 1.0, HEDGE_LEAVES)
    tint = np.outer(np.repeat(light, 3), (0.66, 0.82, 0.70)) * rng.uniform(0.8, 1.0, (3 * HEDGE_LEAVES, 1))
    normals = np.repeat(unit(outward + 0.5 * out + (0.0, 0.0, 0.2)), 3, axis=0)
    made.add(Part("leaf", corners, np.arange(3 * HEDGE_LEAVES).reshape(-1, 3), normals, np.clip(tint, 0.0, 1.0)))
    made.add(box("leaf", (-0.5, -0.20, 0.0), (0.5, 0.20, 0.82), tint=0.10))
    return made
