"""A clothed body on a skeleton: limbs, trunk, head, hair and shoes as smooth skins that follow the joints.

Every skin has the same rings in every pose, so that the poses of one person agree vertex by vertex, and right limbs are
the left ones' mirror images at half a cycle's distance.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from assets.models.common import Floats, Part
from assets.models.gait import Limb, Pose, Proportions
from assets.models.rings import ring_angles, rings_along, rotation, skin, superellipse, unit

FORWARD: Final = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Clothes:
    """What a person wears, and how stout they are. Lengths in metres."""

    girth: float = 1.0
    """Of trunk and limbs, 1 for a man of 75 kg."""
    shoulder_half_m: float = 0.205
    hem: float = 0.47
    """Height of the upper garment's lower edge, as a share of stature."""
    sleeve: float = 1.0
    """How far down the arm the sleeve goes: 0.45 for short sleeves, 1 for long ones."""
    loose_m: float = 0.008
    """Of the upper garment about the trunk."""
    leg: float = 1.0
    """How far down the leg the trousers go: 0.5 for shorts, 1 for long ones, 0 for none."""
    trouser_loose_m: float = 0.01
    skirt: float = 0.0
    """Height of the skirt's hem as a share of stature; 0 for none."""
    bust_m: float = 0.0
    waist: float = 1.0
    """Width of the waist against a straight trunk's."""
    collar_m: float = 0.012
    """How far the collar stands up the neck; below nought, how far the neck is bare."""


def _folds(sides: int, at: Floats, where: float, spread: float, depth_m: float, seed: int) -> Floats:
    """How far cloth bulges at rings `at` (r,) round `where`: (r, sides), the same on both sides of the body."""
    rng = np.random.default_rng(seed)
    bulge = rng.uniform(-1.0, 1.0, (len(at), sides))
    envelope = np.exp(-(((at - where) / spread) ** 2))
    return np.asarray(depth_m * bulge * envelope[:, None])


def _cloth(material: str, rings: Floats, folds: Floats) -> Part:
    """A skin with each point moved outwards from its ring's middle by `folds` (r, s), darker in the valleys."""
    middle = rings.mean(axis=1, keepdims=True)
    shade = 1.0 + 14.0 * np.clip(folds, -0.02, 0.0)
    return skin(material, rings + unit(rings - middle) * folds[..., None], tint=shade)


def _bent_path(limb: Limb, at: Floats, round_m: float) -> Floats:
    """Points at `at` along a two-bone limb: 0 its root, 1 its middle joint, 2 its tip; rounded about the joint."""
    upper, lower = limb.bend - limb.root, limb.tip - limb.bend
    points = np.where((at <= 1.0)[:, None], limb.root + at[:, None] * upper, limb.bend + (at - 1.0)[:, None] * lower)
    inwards = (limb.root + limb.tip) / 2.0 - limb.bend
    near = np.exp(-(((at - 1.0) / 0.22) ** 2))[:, None]
    reach = min(1.0, round_m / max(float(np.linalg.norm(inwards)), 1e-6))
    return np.asarray(points + near * inwards * 0.25 * reach)


def leg(body: Proportions, wear: Clothes, limb: Limb) -> list[Part]:
    """One leg as the left one: trouser leg, and bare skin below it."""
    h, g = body.height_m / 1.77, wear.girth
    at = np.array([-0.02, 0.15, 0.35, 0.55, 0.75, 0.92, 1.06, 1.22, 1.45, 1.7, 1.9, 2.02])
    bare = np.array([0.084, 0.082, 0.076, 0.069, 0.060, 0.054, 0.050, 0.052, 0.052, 0.043, 0.037, 0.037]) * h * g
    path = _bent_path(limb, at, 0.06 * h)
    path[:, 0] -= np.interp(at, [1.0, 1.35, 1.8], [0.0, 0.018, 0.0]) * h  # the calf
    parts = []
    if wear.leg > 0.0:
        end = 2.0 * wear.leg + 0.04
        worn = at <= end
        cloth = bare + wear.trouser_loose_m * h * np.interp(at, [0.0, 0.6, 1.3, 2.0], [0.3, 0.8, 1.3, 2.2])
        rings = rings_along(path, np.stack([cloth * 1.06, cloth], axis=1), FORWARD, 8, 2.2)
        folds = _folds(8, at, 1.0, 0.32, 0.010 * h, 1) + _folds(8, at, 1.95, 0.25, 0.009 * h, 2)
        parts.append(_cloth("bottom", rings[worn], folds[worn]))
    if wear.leg < 0.9:
        shown = at >= max(2.0 * wear.leg - 0.3, 0.7)
        rings = rings_along(path, np.stack([bare, bare], axis=1), FORWARD, 8)
        parts.append(skin("skin", rings[shown]))
    return parts


def shoe(body: Proportions, ankle: Floats, pitch_rad: float, yaw_rad: float) -> Part:
    """A shoe about an ankle, its sole flat on the ground when the pitch is nought."""
    length = body.foot_m
    # Along the foot from the heel: middle, half width, top; the sole is flat.
    along = np.array([0.0, 0.05, 0.22, 0.42, 0.62, 0.82, 0.95, 1.0])
    half = np.array([0.075, 0.115, 0.125, 0.13, 0.165, 0.16, 0.11, 0.055]) * length
    top = np.array([0.20, 0.29, 0.33, 0.28, 0.20, 0.16, 0.125, 0.08]) * length
    inner = np.array([0.0, 0.0, 0.0, 0.005, 0.015, 0.012, -0.004, -0.01]) * length
    section = np.array([(-0.95, 0.0), (-1.0, 0.35), (-0.75, 0.82), (0.0, 1.0), (0.75, 0.82), (1.0, 0.35), (0.95, 0.0)])
    rings = np.empty((len(along), len(section), 3))
    for i in range(len(along)):
        rings[i, :, 0] = (along[i] - 0.27) * length
        rings[i, :, 1] = -section[:, 0] * half[i] - inner[i]
        rings[i, :, 2] = section[:, 1] * top[i] - body.ankle_m
    turn = rotation("z", yaw_rad) @ rotation("y", -pitch_rad)
    return skin("shoes", rings @ turn.T + ankle)


def arm(body: Proportions, wear: Clothes, limb: Limb) -> list[Part]:
    """One arm as the left one: sleeve, bare arm below it, and the hand."""
    h, g = body.height_m / 1.77, 0.5 + 0.5 * wear.girth
    at = np.array([-0.085, -0.045, 0.06, 0.22, 0.42, 0.7, 0.9, 1.1, 1.4, 1.75, 1.98])
    bare = np.array([0.024, 0.046, 0.056, 0.053, 0.047, 0.042, 0.04, 0.039, 0.037, 0.030, 0.026]) * h * g
    path = _bent_path(limb, at, 0.04 * h)
    cloth = bare + wear.loose_m * h * np.interp(at, [-0.1, 0.1, 1.0, 2.0], [0.1, 0.8, 1.2, 1.3])
    parts = []
    worn = at <= 2.0 * wear.sleeve + 0.01
    rings = rings_along(path, np.stack([cloth * 1.05, cloth], axis=1), FORWARD, 8)
    folds = _folds(8, at, 1.0, 0.35, 0.009 * h, 3) + _folds(8, at, 0.1, 0.25, 0.006 * h, 4)
    parts.append(_cloth("top", rings[worn], folds[worn]))
    if wear.sleeve < 0.95:
        shown = at >= 2.0 * wear.sleeve - 0.3
        rings = rings_along(path, np.stack([bare, bare * 0.92], axis=1), FORWARD, 8)
        parts.append(skin("skin", rings[shown]))
    return parts + hand(body, limb)


def hand(body: Proportions, limb: Limb) -> list[Part]:
    """A loosely curled hand beyond the wrist, thumb forward."""
    h = body.height_m / 1.77
    along = unit(limb.tip - limb.bend)
    at = np.array([-0.015, 0.02, 0.055, 0.085, 0.11, 0.13]) * h
    half = (
        np.array([(0.026, 0.021), (0.031, 0.019), (0.040, 0.019), (0.038, 0.021), (0.032, 0.022), (0.020, 0.014)]) * h
    )
    path = limb.tip + at[:, None] * along
    # The fingers curl to the thigh.
    path[:, 1] -= np.array([0.0, 0.0, 0.002, 0.008, 0.020, 0.034]) * h
    thumb = limb.tip + np.outer(np.array([0.02, 0.05, 0.08]) * h, along)
    thumb[:, 0] += np.array([0.022, 0.044, 0.050]) * h
    thumb[:, 1] -= np.array([0.002, 0.010, 0.020]) * h
    tips = np.array([(0.012, 0.012), (0.011, 0.011), (0.006, 0.006)]) * h
    return [skin("skin", rings_along(path, half, FORWARD, 6)), skin("skin", rings_along(thumb, tips, FORWARD, 4))]


def _trunk_rings(
    pose: Pose, body: Proportions, levels: Floats, half: Floats, forward_m: Floats, *, sides: int = 14, exponent: float
) -> Floats:
    """Rings about the trunk: `levels` (r,) as shares of stature, `half` (r, 2) is depth and width."""
    rings = np.empty((len(levels), sides, 3))
    hip = body.hip_m / body.height_m
    for i, level in enumerate(levels):
        up = np.clip((level - hip) / (0.80 - hip), 0.0, 1.0)
        yaw = pose.pelvis_yaw_rad + up * (pose.thorax_yaw_rad - pose.pelvis_yaw_rad)
        flat = superellipse(sides, half[i, 0], half[i, 1], exponent)
        local = np.column_stack([flat[:, 0] + forward_m[i], flat[:, 1], np.zeros(sides)])
        local[:, 2] = (level - hip) * body.height_m * (body.trunk if level > hip else 1.0)
        rings[i] = pose.pelvis + (local @ rotation("y", pose.lean_rad).T) @ rotation("z", yaw).T
    return rings


_LEVELS = np.array([0.47, 0.50, 0.53, 0.57, 0.61, 0.65, 0.695, 0.735, 0.77, 0.80, 0.82, 0.835, 0.848, 0.862])
_DEPTH = np.array([0.121, 0.120, 0.114, 0.104, 0.100, 0.103, 0.110, 0.112, 0.106, 0.094, 0.083, 0.074, 0.066, 0.062])
_WIDTH = np.array([0.178, 0.180, 0.176, 0.168, 0.163, 0.166, 0.176, 0.186, 0.195, 0.203, 0.194, 0.146, 0.088, 0.064])
_SHIFT = np.array([0.0, 0.0, 0.0, 0.0, 0.002, 0.002, 0.0, -0.004, -0.010, -0.016, -0.020, -0.020, -0.016, -0.010])


def _size(body: Proportions, wear: Clothes, levels: Floats) -> tuple[Floats, Floats, Floats]:
    """Half depth, half width and shift forward of the clothed trunk at levels (shares of stature), metres."""
    h = body.height_m / 1.77
    waist = 1.0 + (wear.waist - 1.0) * np.exp(-(((levels - 0.62) / 0.05) ** 2))
    depth, width, shift = (np.interp(levels, _LEVELS, table) * h for table in (_DEPTH, _WIDTH, _SHIFT))
    bust = wear.bust_m * np.exp(-(((levels - 0.725) / 0.028) ** 2))
    depth = depth * wear.girth * (0.5 + 0.5 * waist) + wear.loose_m * h + 0.5 * bust
    width = width * waist * wear.shoulder_half_m / 0.205 + wear.loose_m * h
    return depth, width, shift + 0.5 * bust


def trunk(pose: Pose, body: Proportions, wear: Clothes) -> list[Part]:
    """The upper garment from its hem to its collar, and the neck."""
    h = body.height_m / 1.77
    levels = np.concatenate([[wear.hem], _LEVELS[wear.hem + 0.012 < _LEVELS]])
    depth, width, shift = _size(body, wear, levels)
    levels[-1] += wear.collar_m / body.height_m
    depth[-1], width[-1] = (0.060 * h + abs(wear.collar_m) * 0.5,) * 2
    rings = _trunk_rings(pose, body, levels, np.stack([depth, width], axis=1), shift, exponent=2.5)
    folds = _folds(14, levels, 0.60, 0.10, 0.012 * h, 5)
    folds = (folds + folds[:, ::-1]) / 2.0
    at = np.array([0.835, 0.86, 0.885])
    neck = _trunk_rings(
        pose, body, at, np.array([(0.056, 0.058), (0.054, 0.056), (0.056, 0.055)]) * h,
        np.array([-0.012, 0.0, 0.012]) * h, sides=8, exponent=2.0,
    )  # fmt: skip
    return [_cloth("top", rings, folds), skin("skin", neck)]


def seat(pose: Pose, body: Proportions, wear: Clothes) -> Part:
    """What trousers or skirt cover between waist and crotch."""
    h = body.height_m / 1.77
    levels = np.array([0.455, 0.475, 0.50, 0.53, 0.57, 0.60])
    half = np.array([(0.06, 0.10), (0.094, 0.155), (0.109, 0.172), (0.108, 0.169), (0.099, 0.160), (0.094, 0.155)]) * h
    half[:, 0] *= wear.girth
    half[:, 1] *= wear.shoulder_half_m / 0.205
    shift = np.array([0.0, -0.006, -0.008, -0.006, 0.0, 0.0]) * h
    return skin("bottom", _trunk_rings(pose, body, levels, half, shift, sides=12, exponent=2.4))


def draped(pose: Pose, body: Proportions, wear: Clothes, material: str, top: float, hem: float, out_m: float) -> Part:
    """Cloth hanging round both legs from a height to a hem (shares of stature): a skirt, or the skirts of a coat.

    It lies `out_m` outside the trunk's clothes where it starts.
    """
    h, girth, flare_m = body.height_m / 1.77, wear.girth, 0.035
    depth, width, shift = _size(body, wear, np.array([top]))
    size = np.stack([depth + out_m, width + out_m], axis=1)
    start = _trunk_rings(pose, body, np.array([top]), size, shift, sides=16, exponent=2.5)[0]
    angle = ring_angles(16)
    rings = []
    for share in np.linspace(0.0, 1.0, 6):
        level = (top + (hem - top) * share) * body.height_m
        spots = [_leg_at(limb, level) for limb in pose.legs]
        front, back = max(p[0] for p in spots), min(p[0] for p in spots)
        thick = (0.085 - 0.025 * share) * h * girth + flare_m * share + out_m + wear.loose_m * h * (material == "top")
        half_x = (front - back) / 2.0 + thick
        half_y = float(width[0]) + out_m + (0.012 - 0.03 * share) * h + flare_m * share
        flat = superellipse(16, half_x, half_y, 2.3)
        # The side of the leading leg hangs further forward.
        lead = (spots[0][0] - spots[1][0]) / 2.0 * 0.55
        x = (front + back) / 2.0 + flat[:, 0] * 0.9 + lead * np.sin(angle)
        ring = np.column_stack([x, flat[:, 1] + pose.pelvis[1], np.full(16, level)])
        wave = 0.006 * h * share * np.cos(5.0 * angle)
        ring[:, :2] += wave[:, None] * unit(ring[:, :2] - ring[:, :2].mean(axis=0))
        blend = float(np.clip(share / 0.4, 0.0, 1.0))
        rings.append((1.0 - blend) * (start + (0.0, 0.0, level - top * body.height_m)) + blend * ring)
    return skin(material, rings[::-1])


def _leg_at(limb: Limb, height: float) -> Floats:
    """The point of a leg at a height, (3,)."""
    for top, bottom in ((limb.root, limb.bend), (limb.bend, limb.tip)):
        if height >= bottom[2]:
            share = float(np.clip((top[2] - height) / max(top[2] - bottom[2], 1e-6), 0.0, 1.0))
            return np.asarray(top + share * (bottom - top))
    return limb.tip
