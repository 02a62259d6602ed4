"""The messages between the simulation's process and its owner: a job, and parts of the recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from pavetwin.arrays import Float64Array, UInt32Array
from pavetwin.traffic.area_traffic import AreaTraffic, Trip
from pavetwin.traffic.speed_limits import SpeedLimits

STEP_S: Final = 0.5
"""SUMO's step and the recording's."""

OUTPUT: Final = "output.txt"
"""In a job's folder: what SUMO prints."""


@dataclass(frozen=True)
class SimulationJob:
    """What one simulation needs. Paths are absolute."""

    folder: str
    """Temporary folder of this simulation; its process removes it if the owner was killed."""
    network: str
    lanes_of: Mapping[str, Sequence[str]]
    """The lanes of each directed edge of the world, from the kerb to the middle of the street."""
    additional: str
    routes: list[str]
    """A user's own demand; empty for the closed loop."""
    seed: int
    sumo_seed: int
    warm_up_s: tuple[float, float]
    """The shortest and the longest warm-up."""
    begin_s: float = 0.0
    """SUMO's clock at its first step."""
    vehicles: int = 0
    pedestrians: int = 0
    options: Sequence[str] = ()
    """Of SUMO, in place of those of every recording that set the same."""
    vehicle_types: Sequence[tuple[str, float]] = ()
    """SUMO's, of the closed loop's vehicles, with their shares."""
    fastest_goals: bool = True
    """Whether a trip of the closed loop leads to the fastest of several random goals."""
    speed_ratio: float | None = None
    """That is held by changing the number of vehicles (`level_control`)."""
    speed_limits: SpeedLimits | None = None
    """Needed for that."""
    area: frozenset[str] | None = None
    """The edges that traffic of the closed loop uses; None for all."""
    area_traffic: AreaTraffic | None = None
    """The vehicles of the area, where they are those of its town; None for a closed loop of its own."""
    reads_trips: bool = False
    """Whether the trips of vehicles are read in place of poses."""
    reads_pedestrians: bool = True
    """Whether pedestrians are among the rows; they walk in any case."""


@dataclass(frozen=True, slots=True)
class Body:
    """One agent as SUMO knows it. A user's person may have a vehicle's id."""

    id: str
    is_pedestrian: bool
    kind: str
    length_m: float
    width_m: float
    height_m: float


@dataclass(frozen=True, eq=False)
class Part:
    """Consecutive frames. Rows are sorted by (frame, agent)."""

    start_s: float
    """Simulated time of the recording's first frame, in every part."""
    sumo_version: str
    bodies: Sequence[Body]
    """The agents that are new in this part; numbered in this order from the first part on."""
    rows: UInt32Array
    """(frames,) how many each frame has"""
    agent: UInt32Array
    """(rows,)"""
    x: Float64Array
    """(rows,) of a vehicle's front bumper, of a person's centre, metres east"""
    y: Float64Array
    """(rows,) metres north"""
    heading_deg: Float64Array
    """(rows,) clockwise from north"""
    speed_mps: Float64Array
    """(rows,)"""
    removals: Sequence[tuple[int, int]]
    """(step of the recording, number of vehicles that SUMO removed from gridlock)"""
    signals: Mapping[str, Sequence[tuple[int, str]]]
    """Per traffic light, (step of the recording, state of its links) at step 0 and at each change."""
    trips: Sequence[Trip] = ()
    """Of all vehicles so far, where the job asks for them."""
