"""What a mission takes and shows at best, before it is flown: the same flight over empty streets.

Traffic is left out, and so are the policy's reactions to it: they make a mission longer and hide some of the surface.
Parked vehicles stand where they do in the mission.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pavetwin.config import MissionSettings
from pavetwin.mission.empty_streets import EmptyStreets
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.mission.fly import fly_over
from pavetwin.mission.results import totals
from pavetwin.uav import camera_of


@dataclass(frozen=True, slots=True)
class MissionEstimate:
    """Of a mission over empty streets."""

    segments: int
    length_m: float
    """Of the segments."""
    pixel_mm: float
    """What a pixel of the camera covers on the ground."""
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
        environment: of the mission, with its parked vehicles.
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
