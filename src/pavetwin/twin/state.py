"""The twin's values at one moment: the agents A_t, parked vehicles, and the UAV x_t. Notation of arXiv 2606.20742,
section III."""

from dataclasses import dataclass
from enum import StrEnum
from math import degrees

from pavetwin.traffic.kinds import AgentClass

Place = tuple[float, float]
"""East and north in the world frame, metres."""


@dataclass(frozen=True, slots=True)
class Agent:
    """One dynamic agent (y, ν, κ) and its body, or a parked vehicle."""

    id: int
    kind: AgentClass
    position: Place
    """Centre of the body on the ground."""
    velocity_mps: Place
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float
    is_parked: bool = False
    """It stays where it is for the whole mission: waiting for what it hides is no use."""

    @property
    def heading_deg(self) -> float:
        """Clockwise from north, as SUMO has it."""
        return (90 - degrees(self.yaw_rad)) % 360


class Mode(StrEnum):
    """What the UAV is doing."""

    GROUND = "ground"
    CLIMB = "climb"
    TRANSIT = "transit"
    INSPECT = "inspect"
    WAIT = "wait"
    DISPLACE = "displace"
    REVISIT = "revisit"
    HOME = "home"
    LAND = "land"
    SWAP = "swap"
    AVOID = "avoid"


@dataclass(frozen=True, slots=True)
class UavState:
    """x_t = (p, h, v, e), with the yaw and what it is doing."""

    position: Place
    altitude_m: float
    speed_mps: float
    battery: float
    """e ∈ [0, 1]."""
    yaw_rad: float
    mode: Mode
