"""Estimate of a mission before it is flown: the same flight over empty streets.

It leaves out traffic, which hides some of the surface, and the policy's reactions, which make a mission longer. Parked
vehicles stand where they do in the mission.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin._core import Trace
from pavetwin.config import MissionSettings
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.fly import fly_over
from pavetwin.mission.metrics import totals
from pavetwin.uav import camera_of

_FIRST_S: Final = 3600.0
_STEP_S: Final = 60.0


class EmptyStreets:
    """Traffic without agents, of any length, for flights that are only planned."""

    def __init__(self) -> None:
        self.duration_s = _FIRST_S

    def trace(self) -> Trace:
        nothing, none = np.empty(0, dtype=np.float32), np.empty(0, dtype=np.uint32)
        steps = round(self.duration_s / _STEP_S) + 1
        return Trace(
            step_s=_STEP_S,
            step_offsets=np.zeros(steps + 1, dtype=np.uint32),
            agent=none,
            x_m=nothing,
            y_m=nothing,
            yaw_rad=nothing,
            speed_mps=nothing,
            length_m=nothing,
            width_m=nothing,
            height_m=nothing,
            base_m=nothing,
            is_pedestrian=np.empty(0, dtype=np.bool_),
        )

    def extend(self, needed_s: float) -> Trace:
        self.duration_s = 2 * max(self.duration_s, needed_s)
        return self.trace()


@dataclass(frozen=True, slots=True)
class MissionEstimate:
    """Effort and coverage of a mission over empty streets."""

    segments: int
    length_m: float
    """Total length of the segments."""
    pixel_mm: float
    """Ground resolution of the camera."""
    images: int
    time_s: float
    """From take-off to landing, swaps included."""
    energy: float
    """In batteries."""
    batteries: int
    """Full batteries to bring."""
    surface_coverage: float
    """Share of the segments' surface that the captures see."""


def estimate(environment: MissionEnvironment, settings: MissionSettings, targets: Sequence[int]) -> MissionEstimate:
    """Fly the policy `baseline`, which never reacts, over empty streets.

    Args:
        environment: the mission's environment, with its parked vehicles.
        targets: indices of the segments in order, see `choose_targets`.

    Raises:
        PaveTwinError: a segment cannot be reached, or not with one set of batteries.
    """
    plain = settings.model_copy(
        update={
            "sensing": settings.sensing.model_copy(update={"sensor": "ideal", "options": {}}),
            "policy": settings.policy.model_copy(update={"options": {}}),
        }
    )
    flown = fly_over(environment, EmptyStreets(), plain, targets, "baseline")
    sums = totals(flown)
    return MissionEstimate(
        segments=sums.segments,
        length_m=sum(row.length_m for row in flown.rows),
        pixel_mm=1000 * camera_of(settings).ground_resolution_m(settings.altitude_m),
        images=len(flown.captures["t_s"]),
        time_s=sums.time_s,
        energy=sums.energy,
        batteries=sums.batteries,
        surface_coverage=sums.surface_coverage or 0.0,
    )
