"""Agents of a recording and parked vehicles as instances of models."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import BoolArray, Float64Array, Int64Array
from pavetwin.scene.appearance import STAND, AgentAppearance, appearance_of, parked_appearance, tints
from pavetwin.scene.models import BODY
from pavetwin.scene.values import Instance, Model, agent_label, parked_label
from pavetwin.traffic.agent_states import AgentStateReader
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of

BRAKING_MPS2: Final = 0.7
"""UN Regulation 13-H, 5.2.22.4: at less deceleration without the pedal brake lamps must not be lit."""

STANDING_MPS: Final = 0.2
"""Slower vehicles stand with the brake on; slower people stand."""

BRAKE_GLOW: Final = 1.5  # See `Instance.tints`
_LAMP_REAR: Final = 2  # Slot of the rear lamps


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
        self._models = models
        self._trace = trace_of(recording)
        self._ways = AgentStateReader(recording)
        self._appearance = cache(lambda agent: appearance_of(recording.agents, agent, seed, models))

    def appearance(self, agent: int) -> AgentAppearance:
        return self._appearance(agent)

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
        appearance, part = self.appearance(agent), BODY
        colours = appearance.tints
        if appearance.stride_m:
            part = self._step(appearance, walked_m) if moves else STAND
        elif brakes:
            colours = colours.copy()
            colours[_LAMP_REAR - 1, 3] = BRAKE_GLOW
        return Instance(
            appearance.model, part, upright(*at, z_m=z_m, scale=appearance.scale), colours, agent_label(agent)
        )

    def _step(self, appearance: AgentAppearance, walked_m: float) -> str:
        steps = sum(part != STAND for part in self._models[appearance.model].parts)
        phase = (appearance.first_phase + walked_m / appearance.stride_m) % 1.0
        return f"walk_{round(phase * steps) % steps}"

    def _braking_and_walked(self, who: Int64Array, time_s: float) -> tuple[BoolArray, Float64Array]:
        """Whether each agent brakes, and how far it has come [m]."""
        steps = time_s / self.recording.step_s
        frame = min(max(0, math.floor(steps + 1e-9)), self.recording.frames - 1)
        share = min(1.0, max(0.0, steps - frame))
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


TOUCHING_M: Final = 0.02  # Vertices of a model below this height are where its tyres touch the ground
NARROW_M: Final = 0.3
"""Models whose tyres lie within this width stand on their side stand (`lean_deg`), whatever slopes below."""

Key = tuple[int, int, float, float, float]


@dataclass(frozen=True, slots=True)
class Wheels:
    """Where a model's tyres touch the ground, in its own frame [m]."""

    front_m: float
    rear_m: float
    half_track_m: float

    @classmethod
    def of(cls, model: Model) -> Self:
        """From the lowest vertices: the middle of those ahead and of those behind, and of those on the left."""
        points = model.parts[BODY].positions
        low = points[points[:, 2] < TOUCHING_M]
        return cls(
            front_m=float(low[low[:, 0] > 0, 0].mean()),
            rear_m=float(low[low[:, 0] < 0, 0].mean()),
            half_track_m=float(np.abs(low[:, 1]).mean()),
        )

    def scaled(self, scale: Float64Array) -> Self:
        """The model at a scale (3,) of length, width and height."""
        length, width = float(scale[0]), float(scale[1])
        return type(self)(self.front_m * length, self.rear_m * length, self.half_track_m * width)

    @property
    def points(self) -> Float64Array:
        """(4, 2) front left, front right, rear left, rear right."""
        return np.array([(x, y) for x in (self.front_m, self.rear_m) for y in (self.half_track_m, -self.half_track_m)])


class ParkedInstances:
    """Parked vehicles of one scene as instances. Each is made at its first use, and kept."""

    def __init__(
        self, *, seed: int, models: Mapping[str, Model], ground: Callable[[Float64Array], Float64Array]
    ) -> None:
        """`ground` gives the height of the ground [m] at points (n, 2)."""
        self._seed, self._models, self._ground = seed, models, ground
        self._wheels_of = cache(lambda name: Wheels.of(models[name]))
        self._made: dict[Key, Instance] = {}

    def of(self, parked: ParkedVehicles) -> tuple[Instance, ...]:
        """One instance a vehicle, in their order."""
        columns = (parked.place, parked.appearance, parked.x, parked.y, parked.yaw_rad)
        keys: list[Key] = list(zip(*(column.tolist() for column in columns), strict=True))
        missing = [row for row, key in enumerate(keys) if key not in self._made]
        if missing:
            self._make([keys[row] for row in missing], [parked.kind[row] for row in missing])
        return tuple(self._made[key] for key in keys)

    def _make(self, keys: list[Key], kinds: list[str]) -> None:
        appearances = [
            parked_appearance(kind, key[1], self._seed, self._models) for key, kind in zip(keys, kinds, strict=True)
        ]
        wheels = [self._wheels_of(appearance.model).scaled(appearance.scale) for appearance in appearances]
        tyres = np.array([each.points for each in wheels])
        x, y, yaw = (np.array(column) for column in list(zip(*keys, strict=True))[2:])
        ahead, left = np.stack([np.cos(yaw), np.sin(yaw)], axis=1), np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
        places = np.stack([x, y], axis=1)[:, None] + tyres[..., :1] * ahead[:, None] + tyres[..., 1:] * left[:, None]
        heights = self._ground(places.reshape(-1, 2)).reshape(-1, 4)
        for row, (key, appearance) in enumerate(zip(keys, appearances, strict=True)):
            stance = self._stance(wheels[row], heights[row], appearance.model)
            transform = upright(*key[2:]) @ stance @ np.diag([*appearance.scale, 1.0])
            self._made[key] = Instance(appearance.model, BODY, transform, appearance.tints, parked_label(key[0]))

    def _stance(self, wheels: Wheels, heights_m: Float64Array, model: str) -> Float64Array:
        """(4, 4) in the vehicle's frame: the plane next to its four wheels' heights (4,), in least squares, as springs
        have it; two-wheelers lean."""
        (front_left, front_right), (rear_left, rear_right) = heights_m.reshape(2, 2)
        pitch = math.atan2((front_left + front_right - rear_left - rear_right) / 2, wheels.front_m - wheels.rear_m)
        if wheels.half_track_m < NARROW_M / 2:
            roll = -math.radians(self._models[model].extras.get("lean_deg", 0.0))
        else:
            roll = math.atan2((front_left + rear_left - front_right - rear_right) / 2, 2 * wheels.half_track_m)
        middle_m = (wheels.front_m + wheels.rear_m) / 2
        turned = _about_y(-pitch) @ _about_x(roll)
        stance = np.eye(4)
        stance[:3, :3] = turned
        stance[:3, 3] = (0.0, 0.0, float(heights_m.mean()) - float(turned[2, 0]) * middle_m)
        return stance


def _about_x(angle_rad: float) -> Float64Array:
    """Left goes up with a positive angle."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


def _about_y(angle_rad: float) -> Float64Array:
    """The front goes down with a positive angle."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
