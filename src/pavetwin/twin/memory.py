"""The inspection memory M_t: an immutable value; every change makes a new one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import dist
from types import MappingProxyType
from typing import Self

from pavetwin.twin.state import Place


class SegmentStatus(StrEnum):
    PENDING = "pending"
    INSPECTED = "inspected"


@dataclass(frozen=True, slots=True)
class Confirmation:
    """When and how a defect was first confirmed."""

    time_s: float
    on_revisit: bool


@dataclass(frozen=True, slots=True)
class Note:
    """A place that was hidden and is to be visited again after the pass."""

    place: Place
    time_s: float
    stay_s: float


@dataclass(frozen=True)
class InspectionMemory:
    """M_t: which segments are inspected, how much of their surface was seen, which defects are confirmed."""

    surface_coverage: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Share of the cells seen so far, by segment; absent when the segment was not begun."""
    status: Mapping[str, SegmentStatus] = field(default_factory=lambda: MappingProxyType({}))
    """Absent means pending."""
    confirmed: Mapping[int, Confirmation] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[Note, ...] = ()
    """Places noted on this pass and not visited yet."""

    def status_of(self, segment: str) -> SegmentStatus:
        return self.status.get(segment, SegmentStatus.PENDING)

    def last_note(self) -> Note | None:
        return self.notes[-1] if self.notes else None

    def noted_near(self, place: Place, radius_m: float) -> bool:
        """Whether a note lies closer than `radius_m` to a place."""
        return any(dist(note.place, place) < radius_m for note in self.notes)

    def confirm(self, defects: Iterable[int], confirmation: Confirmation) -> Self:
        """With defects confirmed; of each the first confirmation stands."""
        new = {defect: confirmation for defect in defects if defect not in self.confirmed}
        if not new:
            return self
        confirmed = MappingProxyType({**self.confirmed, **new})
        return type(self)(self.surface_coverage, self.status, confirmed, self.notes)

    def cover(self, segment: str, coverage: float, inspected_share: float, permanently_hidden: float = 0.0) -> Self:
        """With the seen share of a segment updated.

        Args:
            coverage: share of its cells seen so far.
            inspected_share: it is inspected when this share is seen of the cells that parked vehicles do not hide.
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
