"""What people carry: a backpack, a shoulder bag, a walking stick."""

import numpy as np

from assets.models.common import Floats, Part
from assets.models.gait import STANCE, Pose, Proportions
from assets.models.rings import rings_along, rotation, skin, superellipse

FORWARD = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


def on_thorax(pose: Pose, local: Floats) -> Floats:
    """Points (n, 3) from the pelvis, trunk upright and square, turned and leant as the thorax is."""
    turn = rotation("z", pose.thorax_yaw_rad) @ rotation("y", pose.lean_rad)
    return np.asarray(pose.pelvis + local @ turn.T)


def _strap(pose: Pose, path: Floats, width_m: float) -> Part:
    """A flat band along points of the thorax's frame, lying on what is below and before it."""
    half = np.tile([0.006, width_m / 2.0], (len(path), 1))
    outwards = np.array([0.6, 0.0, 0.8])
    return skin("bag", rings_along(on_thorax(pose, path), half, outwards, 4))


def backpack(pose: Pose, body: Proportions, depth_m: float) -> list[Part]:
    """A town backpack of about 20 litres; `depth_m` is the trunk's half depth."""
    scale = body.height_m / 1.77
    levels = np.array([0.02, 0.06, 0.16, 0.28, 0.38, 0.44, 0.465]) * scale + body.shoulder_m - 0.44 * scale
    half = np.array(
        [(0.05, 0.11), (0.075, 0.14), (0.085, 0.15), (0.08, 0.148), (0.07, 0.138), (0.05, 0.115), (0.02, 0.06)]
    )
    rings = []
    for level, (deep, wide) in zip(levels, half * scale, strict=True):
        flat = superellipse(12, deep, wide, 3.2)
        rings.append(np.column_stack([flat[:, 0] - depth_m - deep + 0.01, flat[:, 1], np.full(12, level)]))
    parts = [skin("bag", on_thorax(pose, np.concatenate(rings)).reshape(len(rings), 12, 3))]
    top = body.shoulder_m
    pocket = []
    for level, deep, wide in ((-0.37, 0.02, 0.09), (-0.355, 0.032, 0.105), (-0.22, 0.032, 0.10), (-0.20, 0.01, 0.085)):
        flat = superellipse(12, deep * scale, wide * scale, 3.5)
        shifted = flat[:, 0] - depth_m - 0.150 * scale
        pocket.append(np.column_stack([shifted, flat[:, 1], np.full(12, top + level * scale)]))
    parts.append(skin("bag", on_thorax(pose, np.concatenate(pocket)).reshape(len(pocket), 12, 3)))
    for side in (1.0, -1.0):
        y = 0.095 * side * scale
        path = np.array(
            [
                (-depth_m - 0.01, y, top + 0.01),
                (-0.05, y, top + 0.055 * scale),
                (0.045, y, top + 0.035 * scale),
                (depth_m + 0.004, y, top - 0.07 * scale),
                (depth_m + 0.016, y * 1.1, top - 0.17 * scale),
                (0.5 * depth_m, y * 1.95, top - 0.30 * scale),
                (-0.6 * depth_m, y * 1.65, top - 0.36 * scale),
            ]
        )
        parts.append(_strap(pose, path, 0.05 * scale))
    return parts


def shoulder_bag(pose: Pose, body: Proportions, depth_m: float, width_m: float, bust_m: float) -> list[Part]:
    """A handbag at the left hip, its strap over the right shoulder of a trunk of a half depth, half width and bust."""
    scale = body.height_m / 1.64
    hip = -0.06 * scale
    rings = []
    for level, deep, wide in ((-0.12, 0.135, 0.035), (-0.10, 0.15, 0.05), (0.06, 0.15, 0.045), (0.10, 0.135, 0.03)):
        flat = superellipse(12, deep * scale, wide * scale, 4.0)
        rings.append(
            np.column_stack([flat[:, 0] - 0.05, flat[:, 1] + width_m + 0.03, np.full(12, level * scale + hip)])
        )
    parts = [skin("bag", on_thorax(pose, np.concatenate(rings)).reshape(len(rings), 12, 3))]
    top = body.shoulder_m
    for face in (1.0, -1.0):
        x = face * (depth_m + 0.014)
        path = np.array(
            [
                (-0.05 + 0.10 * face, width_m + 0.02, hip + 0.09 * scale),
                (x * 0.95, width_m * 0.55, 0.12 * scale),
                (x + bust_m * (face > 0), 0.02, 0.6 * top),
                (x * 0.97 + 0.5 * bust_m * (face > 0), -0.07 * scale, top - 0.05 * scale),
                (-0.03, -0.095 * scale, top + 0.055 * scale),
            ]
        )
        half = np.tile([0.006, 0.016], (len(path), 1))
        parts.append(skin("bag", rings_along(on_thorax(pose, path), half, FORWARD if face > 0 else -FORWARD, 4)))
    return parts


def stick_foot(body: Proportions, phase: float) -> Floats:
    """Where a stick in the right hand meets the ground: with the left foot, and swung forward with it."""
    phase %= 1.0
    ahead, behind = 0.20 * body.stride_m, (0.20 - STANCE) * body.stride_m
    y = -body.shoulder_half_m - 0.08
    if phase <= STANCE:
        return np.array([ahead - body.stride_m * phase, y, 0.0])
    done = (phase - STANCE) / (1.0 - STANCE)
    return np.array([behind + (ahead - behind) * done, y, 0.06 * np.sin(np.pi * done)])


def stick(hand: Floats, foot: Floats) -> list[Part]:
    """A walking stick from the ground to the hand, with a bent handle."""
    shaft = np.array([foot, foot + (hand - foot) * 0.5, hand, hand + (0.0, 0.0, 0.02)])
    handle = hand + np.array([(-0.05, 0.0, 0.02), (0.0, 0.0, 0.03), (0.05, 0.0, 0.025), (0.07, 0.0, 0.01)])
    return [
        skin("wood", rings_along(shaft, np.full((4, 2), 0.010), FORWARD, 6)),
        skin("wood", rings_along(handle, np.full((4, 2), 0.012), UP, 6)),
    ]
