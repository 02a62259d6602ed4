"""Parked vehicles as instances of models: on the ground with all wheels, engine off."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.scene.agents import upright
from pavetwin.scene.looks import parked_look
from pavetwin.scene.model import Instance, Model, parked_label
from pavetwin.scene.models import BODY
from pavetwin.traffic.parked import ParkedVehicles

TOUCHING_M: Final = 0.02
"""Vertices of a model below this height are where its tyres touch the ground."""

NARROW_M: Final = 0.3
"""What has its tyres within this width stands on its side stand, see the model's `lean_deg`, whatever slopes below."""

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
        """Of the model at a scale (3,) of its length, width and height."""
        return replace(
            self,
            front_m=self.front_m * float(scale[0]),
            rear_m=self.rear_m * float(scale[0]),
            half_track_m=self.half_track_m * float(scale[1]),
        )

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
        self._wheels: dict[str, Wheels] = {}
        self._made: dict[Key, Instance] = {}

    def of(self, parked: ParkedVehicles) -> tuple[Instance, ...]:
        """One instance a vehicle, in their order."""
        columns = (parked.place, parked.look, parked.x, parked.y, parked.yaw_rad)
        keys: list[Key] = list(zip(*(column.tolist() for column in columns), strict=True))
        missing = [row for row, key in enumerate(keys) if key not in self._made]
        if missing:
            self._make([keys[row] for row in missing], [parked.kind[row] for row in missing])
        return tuple(self._made[key] for key in keys)

    def _make(self, keys: list[Key], kinds: list[str]) -> None:
        looks = [parked_look(kind, key[1], self._seed, self._models) for key, kind in zip(keys, kinds, strict=True)]
        wheels = [self._wheels_of(look.model).scaled(look.scale) for look in looks]
        tyres = np.array([each.points for each in wheels])
        x, y, yaw = (np.array(column) for column in list(zip(*keys, strict=True))[2:])
        ahead, left = np.stack([np.cos(yaw), np.sin(yaw)], axis=1), np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
        places = np.stack([x, y], axis=1)[:, None] + tyres[..., :1] * ahead[:, None] + tyres[..., 1:] * left[:, None]
        heights = self._ground(places.reshape(-1, 2)).reshape(-1, 4)
        for row, (key, look) in enumerate(zip(keys, looks, strict=True)):
            stance = self._stance(wheels[row], heights[row], look.model)
            transform = upright(*key[2:]) @ stance @ np.diag([*look.scale, 1.0])
            self._made[key] = Instance(look.model, BODY, transform, look.tints, parked_label(key[0]))

    def _wheels_of(self, model: str) -> Wheels:
        if model not in self._wheels:
            self._wheels[model] = Wheels.of(self._models[model])
        return self._wheels[model]

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
