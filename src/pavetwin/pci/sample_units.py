"""Sample units: the parts of segments of which ASTM D6433 surveys the condition, 225 ± 90 m² of asphalt each."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import ceil
from typing import Final

from shapely.geometry.base import BaseGeometry

from pavetwin.world.model import Segment
from pavetwin.world.segments import equal_pieces

USUAL_M2: Final = 225.0
LARGEST_M2: Final = 315.0
SMALLEST_M2: Final = 135.0


@dataclass(frozen=True, slots=True)
class SampleUnit:
    """A part of a segment between two cuts across its street."""

    id: str
    """The segment's and a number along it from 1: `s0007-2`."""
    segment: Segment
    polygon: BaseGeometry

    @property
    def area_m2(self) -> float:
        return float(self.polygon.area)

    @property
    def has_usual_size(self) -> bool:
        """Whether its area is within what the standard names; that of a short segment is below."""
        return SMALLEST_M2 <= self.area_m2 <= LARGEST_M2


def sample_units(segments: Iterable[Segment]) -> tuple[SampleUnit, ...]:
    """The units of segments, in their order: each segment is cut into equal lengths, as near to 225 m² as can be."""
    return tuple(unit for segment in segments for unit in _units_of(segment))


def _units_of(segment: Segment) -> list[SampleUnit]:
    number = max(1, round(segment.area_m2 / USUAL_M2), ceil(segment.area_m2 / LARGEST_M2))
    pieces = equal_pieces(segment.centre_line, segment.polygon, number)
    return [SampleUnit(f"{segment.id}-{place}", segment, polygon) for place, (_, polygon) in enumerate(pieces, start=1)]
