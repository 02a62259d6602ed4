"""Converts the frames of SUMO's process to a recording."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import Float32Array, Float64Array
from pavetwin.seeds import Stream, child
from pavetwin.traffic.body_pose import centre_of_front, yaw_of_heading
from pavetwin.traffic.flow import at_limits
from pavetwin.traffic.job import STEP_S, Body, Part
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.pose_rows import PoseRows
from pavetwin.traffic.recording import Agents, Origin, Recording
from pavetwin.traffic.speed_limits import SpeedLimits

_NONE: Final = np.zeros(0, dtype=np.float32)
NOBODY: Final = Agents((), (), _NONE, _NONE, _NONE, np.zeros(0, dtype=np.bool_))


def to_recording(part: Part, origin: Origin, limits: SpeedLimits, before: Recording | None = None) -> Recording:
    """The recording of `before` (the same simulation so far) followed by `part`.

    The result does not depend on how a simulation is divided into parts.

    Args:
        limits: the world's speed limits.
    """
    known = before.agents if before is not None else NOBODY
    agents = _agents(known, part.bodies, origin.seed)
    yaw = yaw_of_heading(part.heading_deg)
    centre = centre_of_front(np.stack([part.x, part.y], axis=-1), yaw, agents.length_m[part.agent])
    rows = PoseRows(
        step_offsets=np.cumsum(np.concatenate([[0], part.rows])).astype(np.uint32),
        agent=part.agent,
        x=centre[:, 0].astype(np.float32),
        y=centre[:, 1].astype(np.float32),
        yaw_rad=yaw.astype(np.float32),
        speed_mps=part.speed_mps.astype(np.float32),
    )
    removals, signals = tuple(part.removals), {name: tuple(states) for name, states in part.signals.items()}
    if before is None:
        recording = Recording.of_rows(
            origin=origin, step_s=STEP_S, agents=agents, rows=rows, removals=removals, signals=signals
        )
        return replace(recording, at_limits=at_limits(rows, agents.is_pedestrian, limits, STEP_S))
    return replace(
        before,
        origin=origin,
        agents=agents,
        tracks=before.tracks.followed_by(rows, agents.is_pedestrian, STEP_S),
        removals=before.removals + removals,
        signals={name: before.signals[name] + states for name, states in signals.items()},
        at_limits=_followed(before, at_limits(rows, agents.is_pedestrian, limits, STEP_S, before.frames)),
    )


def _followed(before: Recording, samples: Float64Array | None) -> Float64Array | None:
    return None if before.at_limits is None or samples is None else np.concatenate([before.at_limits, samples])


def _agents(known: Agents, bodies: Sequence[Body], seed: int) -> Agents:
    """The known agents followed by the new ones."""
    rng = child(seed, Stream.TRAFFIC, 1)
    kind = (*known.kind, *(body.kind for body in bodies))
    given = [0.0] * len(known) + [body.height_m for body in bodies]
    # Drawn in the order of first appearance, so that a longer recording begins with the same bodies.
    heights = [
        KINDS[name].height_of_one(rng) if name in KINDS else height for name, height in zip(kind, given, strict=True)
    ]
    return Agents(
        id=(*known.id, *(body.id for body in bodies)),
        kind=kind,
        length_m=_and(known.length_m, [body.length_m for body in bodies]),
        width_m=_and(known.width_m, [body.width_m for body in bodies]),
        height_m=_and(known.height_m, np.round(heights[len(known) :], 3)),
        is_pedestrian=np.append(known.is_pedestrian, np.array([body.is_pedestrian for body in bodies], dtype=np.bool_)),
    )


def _and(known: Float32Array, new: npt.ArrayLike) -> Float32Array:
    return np.concatenate([known, np.asarray(new, dtype=np.float32)])
