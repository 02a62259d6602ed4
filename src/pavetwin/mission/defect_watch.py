"""What the captures of a mission show of each defect, by the kernel and the traffic of their moments."""

from collections.abc import Container
from typing import TYPE_CHECKING

import numpy as np

from pavetwin._core import Trace, Viewpoint
from pavetwin.arrays import Float64Array, IndexArray
from pavetwin.config import MissionSettings
from pavetwin.mission.environment import MissionEnvironment, window_m
from pavetwin.world.model import Defect

if TYPE_CHECKING:
    from pavetwin._core import CaptureColumns, DefectShares


class DefectWatch:
    """How much of defects captures show, worked out when the segment of the defects ends: the traffic of that time is
    still in memory then, which is read again for whoever asks after landing."""

    def __init__(self, environment: MissionEnvironment, settings: MissionSettings) -> None:
        self._environment, self._settings = environment, settings
        self.shares: dict[tuple[int, int], DefectShares] = {}
        """Of a defect in a capture, by their numbers."""

    def look_back(self, segment: int, captures: "CaptureColumns", confirmed: Container[int], trace: Trace) -> None:
        """Note the defects of a segment that are not confirmed.

        Args:
            segment: its index.
            captures: of the mission so far.
            confirmed: ids of defects.
        """
        environment = self._environment
        for number in environment.defects_by_segment.get(environment.world.segments[segment].id, ()):
            if number not in confirmed:
                for capture in captures_of(environment.defects[number], captures, segment, self._settings).tolist():
                    self.shares[number, capture] = shares_of(number, capture, captures, environment, trace)


def captures_of(defect: Defect, captures: "CaptureColumns", segment: int, settings: MissionSettings) -> IndexArray:
    """Rows of the captures of a segment, by its index, with a defect's centre in the inspection window."""
    rows = np.flatnonzero(captures["segment"] == segment)
    return rows[in_window(defect, captures["x_m"][rows], captures["y_m"][rows], captures["yaw_rad"][rows], settings)]


def in_window(
    defect: Defect, x_m: Float64Array, y_m: Float64Array, yaw_rad: Float64Array, settings: MissionSettings
) -> IndexArray:
    """Indices of the places of the UAV from which a defect's centre is in the inspection window."""
    across_m, along_m = window_m(settings)
    east, north = defect.centre.x - x_m, defect.centre.y - y_m
    ahead_east, ahead_north = np.cos(yaw_rad), np.sin(yaw_rad)
    along, across = east * ahead_east + north * ahead_north, north * ahead_east - east * ahead_north
    return np.flatnonzero((np.abs(along) <= along_m / 2) & (np.abs(across) <= across_m / 2))


def shares_of(
    defect: int, capture: int, captures: "CaptureColumns", environment: MissionEnvironment, trace: Trace
) -> "DefectShares":
    """What hides a defect in a capture."""
    viewpoint = Viewpoint(
        position=(float(captures["x_m"][capture]), float(captures["y_m"][capture])),
        altitude_m=environment.altitude_m,
        yaw_rad=float(captures["yaw_rad"][capture]),
    )
    return environment.ground.defect_shares(defect, trace, float(captures["t_s"][capture]), viewpoint)
