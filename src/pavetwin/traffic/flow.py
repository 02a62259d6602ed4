"""Traffic flow of a recording: speed, speed ratio, flow, standing vehicles, removals.

All are computed from the recording's own rows, of vehicles only. The free-flow speed of a vehicle is the speed limit of
the lane whose centre line it is nearest to, of those in its direction; inside a junction, that of the lane before or
behind. The speed ratio is the time that the distance driven takes at these speeds, over the time that it took (the
inverse of the travel time index): waiting at signals and turning count as losses, so that even a nearly empty network
stays below 1.

`to_recording` converts the frames of SUMO's process to a recording with these samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import BoolArray, Float32Array, Float64Array
from pavetwin.seeds import Stream, child
from pavetwin.traffic.demand import LevelOfService, level_of
from pavetwin.traffic.job import STEP_S, Body, Part, SpeedLimits, centre_of_front, yaw_of_heading
from pavetwin.traffic.kinds import KINDS
from pavetwin.traffic.recording import SAMPLED_S, Agents, Origin, Recording
from pavetwin.traffic.tracks import PoseRows

FEW_VEHICLE_HOURS: Final = 1.0
"""Fewer, such as five vehicles in ten minutes, give a level of service that depends on the signals they met: it may be
better than any that the network keeps for longer. An assumption of ours."""

MOST_REMOVALS_PER_HOUR: Final = 0.05
"""Vehicles taken out of gridlock per vehicle-hour; more of them show that traffic exceeds the network's capacity."""


@dataclass(frozen=True, slots=True)
class Flow:
    """Means over a recording, of its vehicles. None without vehicles, or in a world without lanes."""

    vehicle_hours: float
    speed_kmh: float | None
    """Distance over time, of all vehicles together (space mean speed)."""
    free_flow_kmh: float | None
    """The same distances, over their time at the speed limits."""
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
        """The traffic in one line."""
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
        """Vehicles taken out of gridlock, and the consequence for the result."""
        removed = self.removed_per_vehicle_hour
        if not removed:
            return "No vehicle was taken out of gridlock."
        removals = f"{removed:.2f} vehicles per vehicle-hour were taken out of gridlock"
        if removed <= MOST_REMOVALS_PER_HOUR:
            return f"{removals}: too few to change what the camera sees."
        return (
            f"{removals}: the streets are beyond capacity and would stand still without that, so a policy that waits "
            "for traffic to move waits less here than it would in reality."
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


def flow_of(recording: Recording) -> Flow:
    """The flow of a recording."""
    numbers = recording.tracks.numbers
    count = int(numbers.vehicles.sum())
    hours = count * recording.step_s / 3600
    lanes_km = recording.origin.capacity.lanes_km
    if not count:
        return Flow(0.0, None, None, None, 0.0 if lanes_km > 0 else None, None, None)
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
    """Rounded values for files, in the order of reading."""
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
