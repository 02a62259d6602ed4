"""How a person walks: the joints of a skeleton at a phase of the gait cycle.

Phase 0 is the left heel's strike, 0.5 the right one's. The curves of thigh, knee and foot are the normal ones of
level walking at free speed, rounded: Perry and Burnfield, Gait Analysis (2nd ed., 2010), chapters 3 to 6; Winter,
Biomechanics and Motor Control of Human Movement (4th ed., 2009), appendix A. They give the swing. In stance the foot
is put where the ground is, moving backwards past the body by the stride once a cycle, and the knee follows by two-
bone inverse kinematics: so no foot slides.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from assets.models.common import Floats
from assets.models.rings import rotation, unit

STANCE: Final = 0.6
"""Share of the cycle in which a foot is on the ground (Perry: 60 %)."""
CLEARANCE: Final = 0.007
"""Least height of the toes in swing as a share of stature (Winter: about 13 mm)."""

_AT = np.array([0.0, 0.05, 0.12, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65, 0.73, 0.8, 0.9, 0.96])
_THIGH_DEG = np.array([22.0, 22.0, 18.0, 9.0, -2.0, -12.0, -19.0, -13.0, -2.0, 14.0, 23.0, 25.0, 23.0])
_KNEE_DEG = np.array([5.0, 10.0, 17.0, 16.0, 8.0, 5.0, 11.0, 36.0, 50.0, 60.0, 50.0, 18.0, 4.0])
_FOOT_DEG = np.array([20.0, 8.0, 0.0, 0.0, 0.0, 0.0, -18.0, -52.0, -60.0, -45.0, -20.0, 8.0, 18.0])
"""Thigh from the vertical, forward positive; knee's bend; foot from the ground, toes up positive."""


@dataclass(frozen=True, slots=True)
class Proportions:
    """Lengths of a skeleton in metres, and how it moves."""

    height_m: float
    stride_m: float
    foot_m: float
    """Length of the shoe."""
    shoulder_half_m: float
    """From the middle to a shoulder's joint."""
    hip_half_m: float
    arm_swing_deg: float = 22.0
    elbow_deg: float = 20.0
    lean_deg: float = 3.0
    """Forward lean of the trunk."""
    step_half_m: float = 0.05
    """From the line of progress to a foot's middle (Winter: step width 8 to 12 cm)."""
    arm_out_deg: float = 6.0
    trunk: float = 1.0
    """Length of the trunk against a grown-up's share of stature: children have bigger heads above shorter ones."""

    # Segment lengths as shares of stature: Drillis and Contini (1966), as in Winter, figure 4.1.
    @property
    def thigh_m(self) -> float:
        return 0.245 * self.height_m

    @property
    def shank_m(self) -> float:
        return 0.246 * self.height_m

    @property
    def ankle_m(self) -> float:
        return 0.045 * self.height_m

    @property
    def upper_arm_m(self) -> float:
        return 0.178 * self.height_m

    @property
    def forearm_m(self) -> float:
        return 0.146 * self.height_m

    @property
    def shoulder_m(self) -> float:
        """Height of the shoulders' joints above the hips'."""
        return self.trunk * (0.808 * self.height_m - self.hip_m)

    @property
    def hip_m(self) -> float:
        """Height of the hip joints when standing, knees a little soft."""
        return 0.995 * (self.thigh_m + self.shank_m) + self.ankle_m


@dataclass(frozen=True, slots=True)
class Limb:
    """The three joints of a leg (hip, knee, ankle) or an arm (shoulder, elbow, wrist), each (3,)."""

    root: Floats
    bend: Floats
    tip: Floats


@dataclass(frozen=True, slots=True)
class Pose:
    """A skeleton. Index 0 is left, 1 is right."""

    pelvis: Floats
    """The middle between the hip joints, (3,)."""
    pelvis_yaw_rad: float
    thorax_yaw_rad: float
    lean_rad: float
    legs: tuple[Limb, Limb]
    foot_pitch_rad: tuple[float, float]
    foot_yaw_rad: tuple[float, float]
    arms: tuple[Limb, Limb]


def _curve(values: Floats, phase: float) -> float:
    return float(np.radians(np.interp(phase % 1.0, _AT, values, period=1.0)))


def _swing_ankle(body: Proportions, phase: float) -> Floats:
    """The ankle from the hip in the sagittal plane, (x, z), after the published angles."""
    thigh, shank = _curve(_THIGH_DEG, phase), _curve(_THIGH_DEG, phase) - _curve(_KNEE_DEG, phase)
    return np.array(
        [
            body.thigh_m * np.sin(thigh) + body.shank_m * np.sin(shank),
            -body.thigh_m * np.cos(thigh) - body.shank_m * np.cos(shank),
        ]
    )


def _stance_ankle(body: Proportions, phase: float) -> Floats:
    """The ankle in the body's frame, (x, z): the foot rolls over the heel, stands, rolls over its ball."""
    pitch = _curve(_FOOT_DEG, phase)
    under = 0.24 * body.stride_m - body.stride_m * phase
    # From the ball to the tip of the toes as the heel rises.
    roll = 0.45 + 0.2 * float(np.clip((-np.degrees(pitch) - 20.0) / 30.0, 0.0, 1.0))
    pivot = np.array([-0.25 if pitch > 0 else roll, 0.0]) * body.foot_m
    arm = np.array([0.0, body.ankle_m]) - pivot
    c, s = np.cos(pitch), np.sin(pitch)
    ankle = np.array([under, 0.0]) + pivot + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
    return np.asarray(ankle)


def _hip_height(body: Proportions, phase: float) -> float:
    """Lowest just after a heel's strike, highest over the standing leg; Winter: 4 to 5 cm from low to high."""
    return body.hip_m * float(0.977 - 0.012 * np.cos(4.0 * np.pi * (phase - 0.03)))


def _ankle(body: Proportions, phase: float) -> Floats:
    """The ankle in the body's frame, (x, z), anywhere in the cycle."""
    phase %= 1.0
    if phase <= STANCE:
        return _stance_ankle(body, phase)
    done = (phase - STANCE) / (1.0 - STANCE)
    ends = [_stance_ankle(body, at) - _swing_ankle(body, at) - (0.0, _hip_height(body, at)) for at in (STANCE, 0.0)]
    hip = np.array([0.0, _hip_height(body, phase)])
    ankle = _swing_ankle(body, phase) + hip + ends[0] * (1.0 - done) + ends[1] * done
    pitch = _curve(_FOOT_DEG, phase)
    toes_down = body.ankle_m * np.cos(pitch) + 0.7 * body.foot_m * np.sin(max(-pitch, 0.0))
    ankle[1] = max(ankle[1], toes_down + CLEARANCE * body.height_m)
    return np.asarray(ankle)


def _bent(root: Floats, tip: Floats, upper: float, lower: float, towards: Floats) -> Limb:
    """Two bones between `root` and `tip`, bent towards `towards`; the tip gives way where they are too short."""
    span = tip - root
    distance = min(float(np.linalg.norm(span)), 0.9995 * (upper + lower))
    along = unit(span)
    tip = root + along * distance
    shadow = (upper**2 - lower**2 + distance**2) / (2.0 * distance)
    out = unit(towards - along * float(towards @ along))
    return Limb(root, root + along * shadow + out * np.sqrt(max(upper**2 - shadow**2, 0.0)), tip)


def _arm(body: Proportions, shoulder: Floats, side: float, flexion: float, elbow: float, yaw: float) -> Limb:
    out = side * np.radians(body.arm_out_deg)
    turn = rotation("z", yaw) @ rotation("x", out) @ rotation("y", -flexion)
    upper = turn @ np.array([0.0, 0.0, -1.0])
    # The forearm points a little inwards, as hands hang before the thighs.
    lower = rotation("z", yaw) @ rotation("x", out * 0.2) @ rotation("y", -flexion - elbow) @ np.array([0.0, 0.0, -1.0])
    bend = shoulder + upper * body.upper_arm_m
    return Limb(shoulder, bend, bend + lower * body.forearm_m)


def _trunk_point(pose_pelvis: Floats, yaw: float, lean: float, local: Floats) -> Floats:
    return pose_pelvis + rotation("z", yaw) @ rotation("y", lean) @ local


def walking(body: Proportions, phase: float) -> Pose:
    """The skeleton at `phase` of its cycle, moving towards x. Its pelvis stays over the origin."""
    wave = float(np.cos(2.0 * np.pi * phase))
    sway = 0.018 * float(np.sin(2.0 * np.pi * phase))
    pelvis = np.array([0.0, sway, _hip_height(body, phase)])
    # Pelvis and thorax turn against each other (Perry: 5° forward on the side of the leading leg).
    pelvis_yaw, thorax_yaw = -np.radians(5.0) * wave, np.radians(6.0) * wave
    lean = np.radians(body.lean_deg)
    legs, arms, pitches = [], [], []
    for side, own in ((1.0, phase), (-1.0, phase + 0.5)):
        hip = pelvis + rotation("z", pelvis_yaw) @ np.array([0.0, side * body.hip_half_m, 0.0])
        x, z = _ankle(body, own)
        ankle = np.array([x, side * body.step_half_m, z])
        legs.append(_bent(hip, ankle, body.thigh_m, body.shank_m, np.array([1.0, side * 0.06, 0.0])))
        pitches.append(_curve(_FOOT_DEG, own))
        swing = -float(np.cos(2.0 * np.pi * (own - 0.02)))
        flexion = np.radians(body.arm_swing_deg * swing - 4.0)
        elbow = np.radians(body.elbow_deg * (1.0 + 0.55 * swing))
        local = np.array([0.0, side * body.shoulder_half_m, body.shoulder_m])
        shoulder = _trunk_point(pelvis, thorax_yaw, lean, local)
        arms.append(_arm(body, shoulder, side, flexion, elbow, thorax_yaw))
    yaw = float(np.radians(7.0))
    return Pose(
        pelvis, float(pelvis_yaw), float(thorax_yaw), float(lean), (legs[0], legs[1]), (pitches[0], pitches[1]),
        (yaw, -yaw), (arms[0], arms[1]),
    )  # fmt: skip


def standing(body: Proportions) -> Pose:
    """The skeleton at rest, feet side by side."""
    pelvis = np.array([0.0, 0.0, body.hip_m])
    lean = float(np.radians(body.lean_deg * 0.3))
    legs, arms = [], []
    for side in (1.0, -1.0):
        hip = pelvis + np.array([0.0, side * body.hip_half_m, 0.0])
        ankle = np.array([-0.2 * body.foot_m, side * (body.hip_half_m + 0.01), body.ankle_m])
        legs.append(_bent(hip, ankle, body.thigh_m, body.shank_m, np.array([1.0, side * 0.06, 0.0])))
        local = np.array([0.0, side * body.shoulder_half_m, body.shoulder_m])
        shoulder = _trunk_point(pelvis, 0.0, lean, local)
        arms.append(_arm(body, shoulder, side, np.radians(-4.0), np.radians(14.0), 0.0))
    yaw = float(np.radians(9.0))
    return Pose(pelvis, 0.0, 0.0, lean, (legs[0], legs[1]), (0.0, 0.0), (yaw, -yaw), (arms[0], arms[1]))
