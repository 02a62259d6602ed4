"""Heads: face, ears, hair and hats, on the trunk of a pose."""

from typing import Final, Literal

import numpy as np

from assets.models.common import Floats, Part
from assets.models.gait import Pose, Proportions
from assets.models.rings import ring_angles, rotation, skin, smooth

Hair = Literal["short", "long", "bun", "tail", "bald"]

CROWN_M: Final = 0.131
"""From a head's middle to the top of its hair, at scale 1."""

# From the chin up: level from the middle, half width, front, back; metres for a head of 0.235 m.
_FACE = np.array(
    [
        (-0.118, 0.022, 0.072, -0.010),
        (-0.108, 0.042, 0.092, 0.010),
        (-0.085, 0.056, 0.098, 0.040),
        (-0.050, 0.067, 0.095, 0.068),
        (-0.010, 0.073, 0.094, 0.088),
        (0.030, 0.077, 0.096, 0.098),
        (0.065, 0.073, 0.086, 0.094),
        (0.093, 0.055, 0.060, 0.072),
        (0.110, 0.028, 0.026, 0.036),
    ]
)


def _placed(pose: Pose, body: Proportions, local: Floats, scale: float) -> Floats:
    """Points of a head's own frame (metres at scale 1, from its middle) in the model's frame; the head looks ahead."""
    height = body.height_m - body.hip_m - CROWN_M * scale
    middle = pose.pelvis + rotation("y", pose.lean_rad) @ np.array([0.02 * scale, 0.0, height])
    return np.asarray(local * scale + middle)


def head(pose: Pose, body: Proportions, scale: float, ears: bool) -> list[Part]:
    """The bare head: skull and face, nose, and ears where no hair covers them."""
    sides = 12
    angle = ring_angles(sides)
    rings = np.empty((len(_FACE), sides, 3))
    for i, (level, half, front, back) in enumerate(_FACE):
        c, s = np.cos(angle), np.sin(angle)
        rings[i] = np.column_stack([np.where(c > 0, front, back) * c, half * s, np.full(sides, level)])
    # Eyes lie in shadow under the brow, lips are darker than cheeks: as tints of the rings at their heights.
    shade = np.ones((len(_FACE), sides))
    front = np.cos(angle)
    shade[5] = np.where((front > 0.6) & (front < 0.95), 0.45, 1.0)
    shade[5] = np.where(front >= 0.95, 0.62, shade[5])
    shade[3] = np.where(front > 0.9, 0.72, 1.0)
    placed = _placed(pose, body, rings.reshape(-1, 3), scale).reshape(rings.shape)
    parts = [skin("skin", placed, tint=shade)]
    nose = np.array([(0.090, 0.012, -0.04), (0.090, -0.012, -0.04), (0.094, 0.0, 0.018), (0.116, 0.0, -0.032)])
    ridge = np.array([(0, 2, 3), (3, 2, 1), (0, 3, 1)])
    parts.append(smooth("skin", _placed(pose, body, nose, scale), ridge))
    for side in (1.0, -1.0) if ears else ():
        ear = np.array([(0.004, 0.070, -0.035), (-0.024, 0.072, -0.03), (-0.030, 0.092, 0.012), (0.004, 0.084, 0.024)])
        both = np.concatenate([ear, ear - (0.0, 0.004, 0.0)]) * (1.0, side, 1.0)
        faces = np.array([(0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6)])[:, :: int(side)]
        parts.append(smooth("skin", _placed(pose, body, both, scale), faces))
    return parts


def _cap(lower: Floats, thick_m: float, rough_m: float, seed: int, levels: int = 5, sides: int = 16) -> Floats:
    """A shell over the skull down to the elevation `lower` (sides,) in radians below the crown: (levels, sides, 3)."""
    angle = ring_angles(sides)
    rng = np.random.default_rng(seed)
    rough = rng.uniform(-1.0, 1.0, (levels, sides))
    rough = (rough + rough[:, ::-1]) / 2.0
    rings = np.empty((levels, sides, 3))
    for i in range(levels):
        down = lower * (0.10 + 0.90 * i / (levels - 1))
        c = np.cos(angle)
        reach_x = np.where(c > 0, 0.098, 0.101) + thick_m
        grow = 1.0 + (rough_m * rough[i]) / 0.1
        rings[i] = np.column_stack(
            [
                reach_x * c * np.sin(down) * grow,
                (0.079 + thick_m) * np.sin(angle) * np.sin(down) * grow,
                0.012 + (0.104 + thick_m) * np.cos(down) * grow,
            ]
        )
    return rings


def _hairline(front_deg: float, side_deg: float, back_deg: float, sides: int = 16) -> Floats:
    """How far hair comes down from the crown round the head, in radians."""
    turn = np.abs(np.degrees(np.arctan2(np.sin(ring_angles(sides)), np.cos(ring_angles(sides)))))
    return np.radians(
        np.interp(turn, [0.0, 45.0, 80.0, 120.0, 180.0], [front_deg, front_deg, side_deg, back_deg, back_deg])
    )


def hair(pose: Pose, body: Proportions, scale: float, style: Hair) -> list[Part]:
    """Hair as a rough shell; long hair falls over the shoulders' back."""
    if style == "bald":
        rings = _cap(_hairline(20.0, 95.0, 115.0), 0.004, 0.004, 11)[2:]
        return [_worn(pose, body, scale, "hair", rings, open_top=True)]
    if style == "short":
        return [_worn(pose, body, scale, "hair", _cap(_hairline(58.0, 84.0, 118.0), 0.012, 0.009, 12))]
    shell = _cap(_hairline(56.0, 112.0, 128.0), 0.015, 0.008, 13)
    if style == "long":
        return [_worn(pose, body, scale, "hair", np.concatenate([shell, _falling(shell[-1])]))]
    parts = [_worn(pose, body, scale, "hair", shell)]
    if style == "bun":
        ball = _cap(np.full(16, np.radians(170.0)), 0.0, 0.006, 14, levels=5) * (0.42, 0.48, 0.42) + (
            -0.105,
            0.0,
            0.045,
        )
        parts.append(_worn(pose, body, scale, "hair", ball))
    else:
        parts.append(_worn(pose, body, scale, "hair", _tail()))
    return parts


def _falling(edge: Floats) -> Floats:
    """Long hair below the shell's edge: the back and the sides fall to the shoulder blades, the front does not."""
    angle = ring_angles(len(edge))
    behind = np.clip((0.35 - np.cos(angle)) / 0.6, 0.0, 1.0)
    rng = np.random.default_rng(15)
    strands = rng.uniform(0.8, 1.1, len(edge))
    strands = (strands + strands[::-1]) / 2.0
    out = []
    for share in (0.33, 0.66, 1.0):
        ring = edge.copy()
        ring[:, 2] -= 0.24 * share * behind * strands
        ring[:, 0] -= 0.035 * share * behind
        ring[:, 1] *= 1.0 + 0.18 * share * behind
        out.append(ring)
    return np.array(out)


def _tail() -> Floats:
    """A pony tail from the back of the head."""
    path = np.array([(-0.085, 0.03), (-0.125, 0.035), (-0.15, -0.01), (-0.155, -0.08), (-0.15, -0.15), (-0.145, -0.2)])
    half = np.array([0.018, 0.024, 0.03, 0.03, 0.022, 0.006])
    angle = ring_angles(16)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    rings = np.empty((len(path), 16, 3))
    for i, (x, z) in enumerate(path):
        out = np.array([tangent[i, 1], -tangent[i, 0]])
        rings[i, :, 0] = x + half[i] * np.cos(angle) * out[0]
        rings[i, :, 1] = half[i] * np.sin(angle)
        rings[i, :, 2] = z + half[i] * np.cos(angle) * out[1]
    return rings[::-1]


def cap(pose: Pose, body: Proportions, scale: float) -> list[Part]:
    """A flat cap with a peak."""
    shell = _cap(_hairline(72.0, 74.0, 80.0), 0.028, 0.002, 16)
    shell[:, :, 2] = 0.012 + (shell[:, :, 2] - 0.012) * 0.92
    angle = np.radians(np.linspace(-62.0, 62.0, 7))
    inner = np.column_stack([0.118 * np.cos(angle), 0.100 * np.sin(angle), np.full(7, 0.047)])
    outer = np.column_stack(
        [0.110 + 0.078 * np.cos(angle), 0.104 * np.sin(angle), 0.030 - 0.012 * np.abs(np.sin(angle))]
    )
    peak = np.concatenate([inner, outer])
    faces = np.array([f for i in range(6) for f in ((i, i + 7, i + 8), (i, i + 8, i + 1))])
    faces = np.concatenate([faces, faces[:, ::-1] + 14])
    both = np.concatenate([peak, peak - (0.0, 0.0, 0.006)])
    return [
        _worn(pose, body, scale, "hat", shell),
        smooth("hat", _placed(pose, body, both, scale), faces),
    ]


def _worn(pose: Pose, body: Proportions, scale: float, material: str, rings: Floats, open_top: bool = False) -> Part:
    """Rings from the crown down as a part in place: turned over, since skins run upwards."""
    placed = _placed(pose, body, rings.reshape(-1, 3), scale).reshape(rings.shape)
    levels, sides, _ = rings.shape
    shade = np.ones((levels, sides))
    if material == "hair":
        # Strands run down: light and dark round the head more than along it.
        rng = np.random.default_rng(17)
        shade = rng.uniform(0.55, 1.0, (1, sides)) * rng.uniform(0.8, 1.0, (levels, sides))
    return skin(material, placed[::-1], start=False, end=not open_top, tint=shade)
