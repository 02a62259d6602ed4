"""The agents of a recording at a time, as instances of models.

Positions between frames are the kernel's, the same that a mission flies against. The gait phase of people depends on
the distance walked, not on time, so that no foot slides. Brake lamps depend on the deceleration.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.scene.looks import STAND, AgentAppearance, look_of, tints
from pavetwin.scene.model import Instance, Model, agent_label
from pavetwin.scene.models import BODY
from pavetwin.traffic.agent_states import AgentStateReader
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of

BRAKING_MPS2: Final = 0.7
"""UN Regulation 13-H, 5.2.22.4: at less deceleration without the pedal brake lamps must not be lit."""

STANDING_MPS: Final = 0.2
"""Slower vehicles stand with the brake on; slower people stand."""

BRAKE_GLOW: Final = 1.5
"""See `Instance.tints`."""

_LAMP_REAR: Final = 2
"""Slot of the rear lamps."""


class Actors:
    """A recording's agents as instances. An agent's appearance is made at its first use, and kept."""

    def __init__(
        self,
        recording: Recording,
        *,
        seed: int,
        models: Mapping[str, Model],
        ground: Callable[[Float64Array], Float64Array],
    ) -> None:
        """`ground` gives the height of the ground [m] at points (n, 2), for the feet of people."""
        self.recording = recording
        self._ground = ground
        self._seed = seed
        self._models = models
        self._trace = trace_of(recording)
        self._ways = AgentStateReader(recording)
        self._looks: dict[int, AgentAppearance] = {}

    def look(self, agent: int) -> AgentAppearance:
        """The appearance of an agent."""
        if agent not in self._looks:
            self._looks[agent] = look_of(self.recording.agents, agent, self._seed, self._models)
        return self._looks[agent]

    def at(self, time_s: float, near: tuple[float, float, float] | None = None) -> tuple[Instance, ...]:
        """All agents at a time, or those within a disc (x, y, radius, metres)."""
        poses = self._trace.agents_at(time_s) if near is None else self._trace.agents_near(*near, time_s)
        who = poses["agent"].astype(np.int64)
        speed = np.hypot(poses["east_mps"], poses["north_mps"])
        braking, walked = self._braking_and_walked(who, time_s)
        feet = np.zeros(len(who))
        on_foot = poses["is_pedestrian"]
        feet[on_foot] = self._ground(np.stack([poses["x_m"], poses["y_m"]], axis=1)[on_foot])
        return tuple(
            self._instance(
                agent=int(who[row]),
                at=(float(poses["x_m"][row]), float(poses["y_m"][row]), float(poses["yaw_rad"][row])),
                z_m=float(feet[row]),
                moves=bool(speed[row] > STANDING_MPS),
                brakes=bool(braking[row]),
                walked_m=float(walked[row]),
            )
            for row in range(len(who))
        )

    def _instance(
        self, agent: int, at: tuple[float, float, float], z_m: float, moves: bool, brakes: bool, walked_m: float
    ) -> Instance:
        look, part = self.look(agent), BODY
        colours = look.tints
        if look.stride_m:
            part = self._step(look, walked_m) if moves else STAND
        elif brakes:
            colours = colours.copy()
            colours[_LAMP_REAR - 1, 3] = BRAKE_GLOW
        return Instance(look.model, part, upright(*at, z_m=z_m, scale=look.scale), colours, agent_label(agent))

    def _step(self, look: AgentAppearance, walked_m: float) -> str:
        steps = sum(part != STAND for part in self._models[look.model].parts)
        phase = (look.first_phase + walked_m / look.stride_m) % 1.0
        return f"walk_{round(phase * steps) % steps}"

    def _frame(self, time_s: float) -> tuple[int, float]:
        """The frame at or before a time, and the share of the step that has passed since."""
        recording = self.recording
        frame = min(max(0, math.floor(time_s / recording.step_s + 1e-9)), recording.frames - 1)
        return frame, min(1.0, max(0.0, time_s / recording.step_s - frame))

    def _braking_and_walked(self, who: Int64Array, time_s: float) -> tuple[BoolArray, Float64Array]:
        """Whether each agent brakes, and how far it has come [m]."""
        frame, share = self._frame(time_s)
        now, then = self._ways.at(who, frame), self._ways.at(who, frame + 1)
        before = np.where(now.is_there, now.speed_mps, np.inf)
        after = np.where(then.is_there, then.speed_mps, before)
        change = np.where(now.is_there, after - before, 0.0) / self.recording.step_s
        braking = (change < -BRAKING_MPS2) | ((before < STANDING_MPS) & (after < STANDING_MPS))
        further = np.where(then.is_there, then.travelled_m, now.travelled_m)
        return np.asarray(braking), np.asarray(now.travelled_m + share * (further - now.travelled_m))


def upright(x_m: float, y_m: float, yaw_rad: float, *, z_m: float = 0.0, scale: npt.ArrayLike = 1.0) -> Float64Array:
    """(4, 4): scale in the model's frame, rotation about the vertical, translation."""
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), (3,))
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) * factors
    matrix[:3, 3] = (x_m, y_m, z_m)
    return matrix


def quadrotor(position: npt.ArrayLike, yaw_rad: float, acceleration_mps2: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Instance:
    """The UAV in flight: its rotor axis tilts with the thrust that balances gravity and the acceleration (3,)."""
    thrust = np.asarray(acceleration_mps2, dtype=np.float64) + (0.0, 0.0, 9.81)
    up = thrust / np.linalg.norm(thrust)
    left = np.cross(up, (math.cos(yaw_rad), math.sin(yaw_rad), 0.0))
    left /= np.linalg.norm(left)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([np.cross(left, up), left, up], axis=1)
    matrix[:3, 3] = np.asarray(position, dtype=np.float64)
    return Instance("quadrotor", BODY, matrix, tints())
