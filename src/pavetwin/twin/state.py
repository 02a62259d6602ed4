"""The twin's values at one moment: the agents A_t, parked vehicles, the UAV x_t and the inspection memory M_t.

Notation of arXiv 2606.20742, section III."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import degrees, dist
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

from pavetwin.traffic.kinds import AgentClass

if TYPE_CHECKING:
    from pavetwin._core import PoseColumns


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
    """It stays for the whole mission, so waiting does not reveal what it hides."""

    @property
    def heading_deg(self) -> float:
        """Clockwise from north, as in SUMO."""
        return (90 - degrees(self.yaw_rad)) % 360


def agents_of(columns: "PoseColumns") -> tuple[Agent, ...]:
    """Agents from the kernel's columns."""
    return tuple(
        Agent(
            id=int(columns["agent"][row]),
            kind=AgentClass.PEDESTRIAN if columns["is_pedestrian"][row] else AgentClass.VEHICLE,
            position=(float(columns["x_m"][row]), float(columns["y_m"][row])),
            velocity_mps=(float(columns["east_mps"][row]), float(columns["north_mps"][row])),
            yaw_rad=float(columns["yaw_rad"][row]),
            length_m=float(columns["length_m"][row]),
            width_m=float(columns["width_m"][row]),
            height_m=float(columns["height_m"][row]),
        )
        for row in range(len(columns["agent"]))
    )


class Mode(StrEnum):
    """Activity of the UAV."""

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
    """x_t = (p, h, v, e), with yaw and mode."""

    position: Place
    altitude_m: float
    speed_mps: float
    battery: float
    """e ∈ [0, 1]."""
    yaw_rad: float
    mode: Mode


class SegmentStatus(StrEnum):
    PENDING = "pending"
    INSPECTED = "inspected"


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Time and circumstance of a defect's first confirmation."""

    time_s: float
    on_revisit: bool


@dataclass(frozen=True, slots=True)
class Note:
    """A hidden place to visit again after the pass."""

    place: Place
    time_s: float
    stay_s: float


@dataclass(frozen=True)
class InspectionMemory:
    """M_t: inspected segments, seen shares of their surface, and confirmed defects; immutable."""

    surface_coverage: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Share of the cells seen so far, by segment; absent before the segment is begun."""
    status: Mapping[str, SegmentStatus] = field(default_factory=lambda: MappingProxyType({}))
    """Status by segment; absent means pending."""
    confirmed: Mapping[int, Confirmation] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[Note, ...] = ()
    """Places noted on this pass and not visited yet."""

    def status_of(self, segment: str) -> SegmentStatus:
        return self.status.get(segment, SegmentStatus.PENDING)

    def last_note(self) -> Note | None:
        return self.notes[-1] if self.notes else None

    def noted_near(self, place: Place, radius_m: float) -> bool:
        """True if a note lies closer than `radius_m` to a place."""
        return any(dist(note.place, place) < radius_m for note in self.notes)

    def confirm(self, defects: Iterable[int], confirmation: Confirmation) -> Self:
        """The memory with defects confirmed; the first confirmation of each counts."""
        new = {defect: confirmation for defect in defects if defect not in self.confirmed}
        if not new:
            return self
        confirmed = MappingProxyType({**self.confirmed, **new})
        return type(self)(self.surface_coverage, self.status, confirmed, self.notes)

    def cover(self, segment: str, coverage: float, inspected_share: float, permanently_hidden: float = 0.0) -> Self:
        """The memory with the seen share of a segment updated.

        Args:
            coverage: share of its cells seen so far.
            inspected_share: share of the cells not hidden by parked vehicles from which it counts as inspected.
            permanently_hidden: share of its cells that parked vehicles hide.
        """
        enough = inspected_share * (1.0 - permanently_hidden)
        status = SegmentStatus.INSPECTED if coverage >= enough else SegmentStatus.PENDING
        return replace(
            self,
            surface_coverage=MappingProxyType({**self.surface_coverage, segment: coverage}),
            status=MappingProxyType({**self.status, segment: status}),
        )

    def note(self, note: Note) -> Self:
        return replace(self, notes=(*self.notes, note))

    def forget_notes(self) -> Self:
        return replace(self, notes=())
