"""People who walk, each a file of nine meshes: `walk_0` to `walk_7`, the phases of one gait cycle, and `stand`.

Sizes are those of the kinds in `pavetwin.traffic.kinds`: at rest, depth, width and height of the body without what it
carries. `stride_m` is the ground covered by one whole cycle: a person who has walked s metres is at phase s / stride_m.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from assets.models import body as bodies
from assets.models import carried, heads
from assets.models.body import Clothes
from assets.models.common import Floats, Model, Part, model
from assets.models.gait import Limb, Pose, Proportions, standing, walking
from pavetwin.traffic.kinds import KINDS

PHASES: Final = 8
CARRIED: Final = frozenset({"bag", "wood"})
Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Person:
    """One individual: kind, build, clothes, what is carried, and the colours of what the scene does not colour."""

    name: str
    kind: str
    proportions: Proportions
    wear: Clothes
    hair: heads.Hair
    head: float
    """Size of the head, 1 for 0.235 m."""
    colours: dict[str, Rgb]
    carries: Literal["backpack", "shoulder_bag", "stick", ""] = ""
    hat: bool = False
    coat_hem: float = 0.0
    """Height of a coat's hem as a share of stature; 0 for none."""


def _proportions(kind: str, stride_m: float, **more: float) -> Proportions:
    size = KINDS[kind]
    half = size.width_m / 0.50
    return Proportions(
        size.height_m,
        stride_m,
        foot_m=0.95 * size.length_m,
        shoulder_half_m=0.172 * half,
        hip_half_m=0.085 * half,
        **more,
    )


# Strides: speed of the kind over a cadence of 117 steps a minute for men and women, 130 for a child of eight, 105 for
# the old (Winter 2009; Perry and Burnfield 2010): speed × 120 / cadence.
PEOPLE: Final[tuple[Person, ...]] = (
    Person(
        "man_jacket", "man", _proportions("man", 1.45),
        Clothes(loose_m=0.020, hem=0.455, collar_m=0.030, trouser_loose_m=0.012), "short", 1.0,
        {"shoes": (0.16, 0.13, 0.10)},
    ),
    Person(
        "man_backpack", "man", _proportions("man", 1.45, arm_swing_deg=19.0),
        Clothes(loose_m=0.010, sleeve=0.42, hem=0.475, collar_m=-0.008), "short", 1.0,
        {"bag": (0.045, 0.05, 0.06)},
        carries="backpack",
    ),
    Person(
        "woman_skirt", "woman", _proportions("woman", 1.30, step_half_m=0.04),
        Clothes(
            0.90, 0.178, hem=0.59, leg=0.0, skirt=0.31, bust_m=0.045, waist=0.84, loose_m=0.006, sleeve=0.62,
            collar_m=-0.012,
        ),
        "long", 0.95,
        {},
    ),
    Person(
        "woman_bag", "woman", _proportions("woman", 1.30, step_half_m=0.04, arm_out_deg=9.0),
        Clothes(0.90, 0.180, hem=0.50, bust_m=0.045, waist=0.88, loose_m=0.014, trouser_loose_m=0.002, collar_m=-0.005),
        "tail", 0.95,
        {"bag": (0.20, 0.085, 0.035), "shoes": (0.6, 0.6, 0.58)},
        carries="shoulder_bag",
    ),
    Person(
        "child", "child", _proportions("child", 1.11, trunk=0.93, elbow_deg=26.0, step_half_m=0.045),
        Clothes(0.92, 0.195, sleeve=0.45, leg=0.48, loose_m=0.012, trouser_loose_m=0.022, collar_m=-0.006),
        "short", 0.89,
        {"shoes": (0.55, 0.55, 0.56)},
    ),
    Person(
        "senior_cap", "senior", _proportions("senior", 1.14, lean_deg=8.0, arm_swing_deg=14.0, step_half_m=0.06),
        Clothes(1.10, loose_m=0.018, hem=0.45, collar_m=0.026, trouser_loose_m=0.016), "bald", 1.0,
        {},
        carries="stick", hat=True,
    ),
    Person(
        "senior_coat", "senior", _proportions("senior", 1.14, lean_deg=6.0, arm_swing_deg=15.0),
        Clothes(1.02, 0.192, hem=0.585, bust_m=0.03, loose_m=0.018, collar_m=0.03, leg=1.0), "bun", 0.97,
        {},
        coat_hem=0.33,
    ),
)  # fmt: skip


def _reaching(shoulder: Floats, body: Proportions, hand: Floats) -> Limb:
    """An arm whose wrist is where a stick's handle is."""
    span = hand - shoulder
    upper, lower = body.upper_arm_m, body.forearm_m
    distance = min(float(np.linalg.norm(span)), 0.999 * (upper + lower))
    along = span / np.linalg.norm(span)
    shadow = (upper**2 - lower**2 + distance**2) / (2.0 * distance)
    back = np.array([-1.0, -0.25, 0.0])
    out = back - along * float(back @ along)
    out /= np.linalg.norm(out)
    bend = shoulder + along * shadow + out * np.sqrt(max(upper**2 - shadow**2, 0.0))
    return Limb(shoulder, bend, shoulder + along * distance)


def _with_stick(pose: Pose, body: Proportions, foot: Floats, reach_m: float) -> tuple[Pose, list[Part]]:
    """The pose with its right hand on a stick that meets the ground at `foot` and is `reach_m` ahead, and the stick."""
    shoulder = pose.arms[1].root
    grip = np.array([0.7 * foot[0] + reach_m, foot[1] + 0.03, 0.50 * body.height_m + foot[2]])
    limb = _reaching(shoulder, body, grip)
    wrist_to_palm = (limb.tip - limb.bend) / np.linalg.norm(limb.tip - limb.bend) * 0.07
    return replace(pose, arms=(pose.arms[0], limb)), carried.stick(limb.tip + wrist_to_palm, foot)


def _posed(person: Person, pose: Pose, stick_foot: Floats, reach_m: float = 0.10) -> list[Part]:
    """The whole person in a pose."""
    body, wear = person.proportions, person.wear
    depth = (0.112 * wear.girth * body.height_m / 1.77) + wear.loose_m
    width = 0.165 * wear.shoulder_half_m / 0.205 * body.height_m / 1.77 + wear.loose_m
    parts: list[Part] = []
    if person.carries == "stick":
        pose, held = _with_stick(pose, body, stick_foot, reach_m)
        parts += held
    elif person.carries == "backpack":
        parts += carried.backpack(pose, body, depth)
    elif person.carries == "shoulder_bag":
        parts += carried.shoulder_bag(pose, body, depth, width, wear.bust_m)
    for index, side in enumerate((1.0, -1.0)):
        parts += _sided(bodies.leg(body, wear, _as_left(pose.legs[index], side)), side)
        parts += _sided(bodies.arm(body, wear, _as_left(pose.arms[index], side)), side)
        ankle = pose.legs[index].tip * (1.0, side, 1.0)
        yaw = side * pose.foot_yaw_rad[index]
        parts += _sided([bodies.shoe(body, ankle, pose.foot_pitch_rad[index], yaw)], side)
    parts += bodies.trunk(pose, body, wear)
    if wear.skirt:
        parts.append(bodies.draped(pose, body, wear, "bottom", 0.605, wear.skirt, 0.015))
    elif person.coat_hem:
        parts.append(bodies.draped(pose, body, wear, "top", 0.60, person.coat_hem, 0.010))
    else:
        parts.append(bodies.seat(pose, body, wear))
    parts += heads.head(pose, body, person.head, ears=person.hair in ("short", "bald"))
    parts += heads.hair(pose, body, person.head, person.hair)
    return parts + (heads.cap(pose, body, person.head) if person.hat else [])


def _as_left(limb: Limb, side: float) -> Limb:
    flip = (1.0, side, 1.0)
    return Limb(limb.root * flip, limb.bend * flip, limb.tip * flip)


def _sided(parts: Sequence[Part], side: float) -> list[Part]:
    return [part if side > 0 else part.mirrored() for part in parts]


def _grounded(parts: Sequence[Part]) -> list[Part]:
    """Lowered or raised by the millimetres that the soles are off the ground."""
    lowest = min(float(part.vertices[:, 2].min()) for part in parts if part.material == "shoes")
    return [part.moved((0.0, 0.0, -lowest)) if part.material != "wood" else part for part in parts]


def extent(parts: Sequence[Part]) -> tuple[Floats, Floats]:
    """Corners of the box about a person without what they carry; a pony tail or a cap's peak adds nothing to depth."""
    points = np.concatenate([part.vertices for part in parts if part.material not in CARRIED])
    depth = np.concatenate([part.vertices[:, 0] for part in parts if part.material not in CARRIED | {"hair", "hat"}])
    low, high = points.min(axis=0), points.max(axis=0)
    low[0], high[0] = depth.min(), depth.max()
    return low, high


def person_model(person: Person) -> Model:
    """All poses, scaled by the few per cent that bring the standing body to its kind's size."""
    kind, body = KINDS[person.kind], person.proportions
    rest_foot = np.array([0.04, -body.shoulder_half_m - 0.05, 0.0])
    rest = _grounded(_posed(person, standing(body), rest_foot, 0.0))
    # A hand on a stick is not where the body ends.
    low, high = extent(_grounded(_posed(replace(person, carries=""), standing(body), rest_foot)))
    size = np.array([kind.length_m, kind.width_m, kind.height_m])
    scale = np.diag(size / (high - low))
    offset = (-0.5 * float(scale[0, 0] * (low[0] + high[0])), 0.0, 0.0)
    poses = {"stand": rest}
    for k in range(PHASES):
        phase = k / PHASES
        poses[f"walk_{k}"] = _grounded(_posed(person, walking(body, phase), carried.stick_foot(body, phase)))
    nodes = []
    for name, parts in sorted(poses.items(), reverse=True):
        shift = offset if name == "stand" else (0.0, 0.0, 0.0)
        nodes.append(Model(name, [part.turned(scale).moved(shift) for part in parts]))
    extras: dict[str, float | str] = {
        "kind": person.kind,
        "stride_m": round(float(body.stride_m * scale[0, 0]), 4),
        "phases": PHASES,
    }
    return Model(f"pedestrian_{person.name}", nodes=nodes[::-1], extras=extras, colours=person.colours)


def _register(person: Person) -> None:
    @model(f"pedestrian_{person.name}")
    def make() -> Model:
        return person_model(person)


for _person in PEOPLE:
    _register(_person)
