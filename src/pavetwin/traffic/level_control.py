"""Holds a level of service over a recording: fewer vehicles where traffic is slower than wanted, more where faster.

One density gives a speed ratio only on average over days: near capacity a queue that happens to spill back changes it
by a tenth or more. So the number of vehicles follows a proportional-integral law on the relative error of the speed
ratio, from the density that `demand_search` found on. Runs only in the simulation's process.
"""

from collections import deque
from math import exp
from typing import Any, Final

import numpy as np

from pavetwin.traffic.body_pose import yaw_of_heading
from pavetwin.traffic.speed_limits import SpeedLimits

EVERY_S: Final = 10
"""The speed ratio is measured so often."""

AVERAGED: Final = 12
"""The proportional part sees the mean of so many measurements: two signal cycles."""

PROPORTIONAL: Final = 0.5
INTEGRAL_PER_S: Final = 1 / 600
"""Relative change of the number of vehicles by a relative error of 1, at once and in each second."""

LARGEST: Final = 0.5
"""The logarithm of the number of vehicles changes by no more than this."""


class LevelControl:
    """Corrects the number of vehicles in the running simulation `sumo` (the libsumo module)."""

    def __init__(self, sumo: Any, limits: SpeedLimits, target: float, vehicles: int) -> None:
        self._sumo = sumo
        self._limits = limits
        self._target = target
        self._found = vehicles
        self._errors: deque[float] = deque(maxlen=AVERAGED)
        self._sum = 0.0

    def vehicles(self) -> int:
        """How many there should be from now on; asked every `EVERY_S` seconds."""
        ratio = self._ratio()
        if ratio is not None:
            error = ratio / self._target - 1
            self._errors.append(error)
            most = LARGEST / INTEGRAL_PER_S
            self._sum = min(most, max(-most, self._sum + error * EVERY_S))
        change = PROPORTIONAL * float(np.mean(self._errors or [0.0])) + INTEGRAL_PER_S * self._sum
        return max(1, round(self._found * exp(min(LARGEST, max(-LARGEST, change)))))

    def _ratio(self) -> float | None:
        vehicle = self._sumo.vehicle
        names = vehicle.getIDList()
        if not names:
            return None
        xy = np.array([vehicle.getPosition(name) for name in names])
        yaw = yaw_of_heading([vehicle.getAngle(name) for name in names])
        speed = np.array([vehicle.getSpeed(name) for name in names])
        return float((speed / self._limits.at(xy[:, 0], xy[:, 1], yaw)).mean())
