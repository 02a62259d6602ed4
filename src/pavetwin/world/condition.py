"""The true condition of a world's pavement: the extent of damage by class on every segment."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import AnyArray
from pavetwin.world.model import Defect, Segment, World


@dataclass(frozen=True, slots=True)
class ClassExtent:
    """The defects of one class on one segment."""

    number: int
    length_m: float
    """Total length of their cracks, as `Defect.length_m` has it."""
    area_m2: float
    """Area of their outlines."""


NOTHING = ClassExtent(0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class SegmentCondition:
    """Damage of one segment."""

    segment: Segment
    extents: dict[str, ClassExtent]
    """Extent by class; classes without a defect there are left out."""

    @property
    def number(self) -> int:
        return sum(extent.number for extent in self.extents.values())

    @property
    def damaged_share(self) -> float:
        """Share of the segment's area within outlines of defects."""
        return sum(extent.area_m2 for extent in self.extents.values()) / self.segment.area_m2

    @property
    def per_100_m2(self) -> float:
        """Number of defects per 100 m²."""
        return 100 * self.number / self.segment.area_m2

    def of(self, kind: str) -> ClassExtent:
        """The extent of a class; zeros where it does not occur."""
        return self.extents.get(kind, NOTHING)


def condition_of(world: World) -> tuple[SegmentCondition, ...]:
    """The condition of each segment, in the order of `world.segments`."""
    by_segment: dict[str, dict[str, list[Defect]]] = {}
    for defect in world.defects:
        by_segment.setdefault(defect.segment, {}).setdefault(defect.kind, []).append(defect)
    return tuple(
        SegmentCondition(
            segment, {kind: _extent(found) for kind, found in sorted(by_segment.get(segment.id, {}).items())}
        )
        for segment in world.segments
    )


def classes_of(world: World) -> list[str]:
    """The classes of the world's defects, by name."""
    return sorted({defect.kind for defect in world.defects})


def condition_columns(world: World) -> dict[str, AnyArray]:
    """The condition as columns (segments,) of a table: ids, and the extent of each class.

    Numbers are counts, lengths in metres, areas in m²; `damaged_share` is a share of the segment's area.
    """
    found = condition_of(world)
    columns: dict[str, AnyArray] = {
        "segment": np.array([each.segment.id for each in found], dtype=object),
        "street": np.array([each.segment.street_name for each in found], dtype=object),
        "area_m2": np.array([round(each.segment.area_m2, 3) for each in found], dtype=np.float64),
        "defects": np.array([each.number for each in found], dtype=np.int64),
        "defects_per_100_m2": np.array([round(each.per_100_m2, 3) for each in found], dtype=np.float64),
        "damaged_share": np.array([round(each.damaged_share, 5) for each in found], dtype=np.float64),
    }
    for kind in classes_of(world):
        extents = [each.of(kind) for each in found]
        columns[f"{kind}_number"] = np.array([extent.number for extent in extents], dtype=np.int64)
        columns[f"{kind}_length_m"] = np.array([round(extent.length_m, 3) for extent in extents], dtype=np.float64)
        columns[f"{kind}_area_m2"] = np.array([round(extent.area_m2, 4) for extent in extents], dtype=np.float64)
    return columns


def _extent(defects: Sequence[Defect]) -> ClassExtent:
    lengths, areas = (sum(values) for values in zip(*((d.length_m, d.area_m2) for d in defects), strict=True))
    return ClassExtent(len(defects), lengths, areas)
