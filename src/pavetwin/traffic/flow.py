"""What a recording is, in a traffic engineer's numbers: speed, speed ratio, flow, standing vehicles, removals.

All are computed from the recording's own rows, of vehicles only. The free-flow speed of a vehicle is the speed limit of
the lane whose centre line it is nearest to, of those in its direction; inside a junction, that of the lane before or
behind. The speed ratio is the time that the distance driven takes at these speeds, over the time that it took (the
inverse of the travel time index): waiting at signals and turning count as losses, so that even a nearly empty network
stays below 1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pavetwin.arrays import BoolArray, Float64Array
from pavetwin.traffic.level_of_service import LevelOfService, level_of
from pavetwin.traffic.pose_rows import PoseRows
from pavetwin.traffic.recording import SAMPLED_S, Recording
from pavetwin.traffic.speed_limits import SpeedLimits
from pavetwin.world.model import World

FEW_VEHICLE_HOURS: Final = 1.0
"""Of fewer, such as five vehicles in ten minutes, the level of service rests on whether these met green signals: it may
be better than any that the network keeps for longer. An assumption of ours."""

MOST_REMOVALS_PER_HOUR: Final = 0.05
"""Vehicles taken out of gridlock per vehicle-hour; more of them say that traffic is beyond the network's capacity."""


@dataclass(frozen=True, slots=True)
class Flow:
    """Means over a recording, of its vehicles. None where there is no vehicle, or the world is not known."""

    vehicle_hours: float
    speed_kmh: float | None
    """Distance over time, of all vehicles together (space mean speed)."""
    free_flow_kmh: float | None
    """The same distances over their time at the speed limits."""
    standing: float | None
    """Share of vehicles slower than `STANDING_MPS`."""
    per_lane_km: float | None
    """Density."""
    flow_per_lane_h: float | None
    """Vehicles per hour and lane: density times speed, or vehicle-kilometres per hour and kilometre of lane."""
    removed_per_vehicle_hour: float | None
    """Taken out after blocking traffic (SUMO's teleports): for five minutes where a level of service or an hour is
    asked for, for two elsewhere."""

    @property
    def ratio(self) -> float | None:
        """Speed over free-flow speed."""
        if self.speed_kmh is None or not self.free_flow_kmh:
            return None
        return self.speed_kmh / self.free_flow_kmh

    @property
    def level(self) -> LevelOfService | None:
        return None if self.ratio is None else level_of(self.ratio)

    @property
    def short(self) -> str:
        """`LOS C, 23 km/h` for titles and legends; empty without vehicles."""
        if self.speed_kmh is None:
            return ""
        return (f"LOS {self.level}, " if self.level else "") + f"{self.speed_kmh:.0f} km/h"

    @property
    def sentence(self) -> str:
        """What the traffic is, in one line."""
        if self.speed_kmh is None or self.standing is None:
            return "There are no vehicles."
        ratio = ""
        if self.ratio is not None:
            few = " by chance, since so few drive" if self.vehicle_hours < FEW_VEHICLE_HOURS else ""
            ratio = f", {100 * self.ratio:.0f} % of the speed limits: level of service {self.level}{few}"
        flow = "" if self.flow_per_lane_h is None else f"; {self.flow_per_lane_h:.0f} vehicles/h per lane"
        return f"Mean speed {self.speed_kmh:.0f} km/h{ratio}; {100 * self.standing:.0f} % of vehicles stand{flow}."

    @property
    def removals_sentence(self) -> str:
        """How many vehicles were taken out of gridlock, and what that means for the result."""
        removed = self.removed_per_vehicle_hour
        if not removed:
            return "No vehicle was taken out of gridlock."
        said = f"{removed:.2f} vehicles per vehicle-hour were taken out of gridlock"
        if removed <= MOST_REMOVALS_PER_HOUR:
            return f"{said}: too few to change what the camera sees."
        return (
            f"{said}: the streets are beyond capacity and would stand still without that, so a policy that waits for "
            "traffic to move waits less here than it would in reality."
        )


def at_limits(
    rows: PoseRows, is_pedestrian: BoolArray, limits: SpeedLimits, step_s: float, first_frame: int = 0
) -> Float64Array | None:
    """(samples, 2): `Recording.at_limits` of consecutive frames, of which the first has that number in the recording.
    None in a world without lanes."""
    if not limits:
        return None
    every = round(SAMPLED_S / step_s)
    frame = rows.frame + first_frame
    chosen = np.flatnonzero((frame % every == 0) & ~is_pedestrian[rows.agent])
    speed = rows.speed_mps[chosen].astype(np.float64)
    free = limits.at(rows.x[chosen], rows.y[chosen], rows.yaw_rad[chosen]) if len(chosen) else speed
    begin, end = -(-first_frame // every), -(-(first_frame + rows.frames) // every)
    sample = frame[chosen] // every - begin
    return np.stack([np.bincount(sample, weight, end - begin) for weight in (speed, speed / free)], axis=-1)


def with_limits(recording: Recording, limits: SpeedLimits) -> Recording:
    """A whole recording, with what its vehicles would have driven at the speed limits."""
    walks = recording.agents.is_pedestrian
    samples = [at_limits(rows, walks, limits, recording.step_s, frame) for frame, rows in recording.tracks.pieces()]
    known = [some for some in samples if some is not None]
    return replace(recording, at_limits=np.concatenate(known) if known else None)


def flow_of(recording: Recording, world: World | None = None) -> Flow:
    """The flow of a recording.

    Args:
        world: that it was made for; a recording that an earlier version made does not know its free-flow speed without.
    """
    numbers = recording.tracks.numbers
    count = int(numbers.vehicles.sum())
    hours = count * recording.step_s / 3600
    lanes_km = recording.origin.capacity.lanes_km
    if not count:
        return Flow(0.0, None, None, None, 0.0 if lanes_km > 0 else None, None, None)
    if world is not None and recording.at_limits is None:
        recording = with_limits(recording, SpeedLimits.of(world))
    speed_kmh, free_mps = 3.6 * (recording.speed_mps_of_vehicles or 0.0), recording.free_flow_mps
    density = count / recording.frames / lanes_km if lanes_km > 0 else None
    return Flow(
        vehicle_hours=hours,
        speed_kmh=speed_kmh,
        free_flow_kmh=None if free_mps is None else 3.6 * free_mps,
        standing=int(numbers.standing.sum()) / count,
        per_lane_km=density,
        flow_per_lane_h=None if density is None else density * speed_kmh,
        removed_per_vehicle_hour=recording.removed / hours,
    )


def as_values(flow: Flow) -> Mapping[str, float | str | None]:
    """For files: rounded, in the order of reading."""
    return {
        "speed_kmh": _rounded(flow.speed_kmh, 2),
        "free_flow_kmh": _rounded(flow.free_flow_kmh, 2),
        "speed_ratio": _rounded(flow.ratio, 4),
        "level_of_service": None if flow.level is None else str(flow.level),
        "standing_share": _rounded(flow.standing, 4),
        "flow_per_lane_h": _rounded(flow.flow_per_lane_h, 1),
        "removed_per_vehicle_hour": _rounded(flow.removed_per_vehicle_hour, 4),
    }


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
