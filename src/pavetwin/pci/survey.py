"""Surveys by ASTM D6433: sample units, their distresses, and their condition index."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, pi
from typing import Final, Protocol

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.defects.severity import Distress
from pavetwin.pci.curves import deduct_value
from pavetwin.pci.index import Deduct, Rating, pavement_condition_index, rating_of
from pavetwin.world.model import Defect, Segment, Severity
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
        """Whether its area is within the range of the standard; that of a short segment is below it."""
        return SMALLEST_M2 <= self.area_m2 <= LARGEST_M2


def sample_units(segments: Iterable[Segment]) -> tuple[SampleUnit, ...]:
    """The units of segments, in their order: each segment is cut into equal lengths, as close to 225 m² as possible."""
    return tuple(unit for segment in segments for unit in _units_of(segment))


def _units_of(segment: Segment) -> list[SampleUnit]:
    number = max(1, round(segment.area_m2 / USUAL_M2), ceil(segment.area_m2 / LARGEST_M2))
    pieces = equal_pieces(segment.centre_line, segment.polygon, number)
    return [SampleUnit(f"{segment.id}-{place}", segment, polygon) for place, (_, polygon) in enumerate(pieces, start=1)]


WIDE_POTHOLE_M: Final = 0.75
POTHOLE_AREA_M2: Final = 0.5
"""A pothole wider than 0.75 m counts as many as its area holds of these (ASTM D6433, X1.13)."""


@dataclass(frozen=True, slots=True)
class UnitCondition:
    """A sample unit as surveyed."""

    unit: SampleUnit
    deducts: tuple[Deduct, ...]
    """One per distress and severity."""
    pci: float
    """0 (failed) to 100 (without distress)."""

    @property
    def rating(self) -> Rating:
        return rating_of(self.pci)


@dataclass(frozen=True, slots=True)
class _Part:
    """Contribution of a defect to a distress in a unit."""

    unit: int
    distress: Distress
    severity: Severity
    quantity: float


class Survey:
    """Sample units with the quantities of their defects, for a quick condition by any subset of the defects.

    A defect that lies in several units counts in each by the share of its outline there; a pothole counts where its
    centre lies. Classes without a distress or not registered, and defects of other segments, do not count.
    """

    def __init__(self, units: Sequence[SampleUnit], defects: Iterable[Defect]) -> None:
        self.units = tuple(units)
        self._parts = {defect.id: parts for defect, parts in _parts(self.units, defects)}

    def conditions(self, found: Iterable[int] | None = None) -> tuple[UnitCondition, ...]:
        """The condition of each unit, in their order.

        Args:
            found: ids of the defects that are known, of those surveyed; all unless given.
        """
        quantities: list[dict[tuple[Distress, Severity], float]] = [{} for _ in self.units]
        for number in self._parts if found is None else found:
            for part in self._parts.get(number, ()):
                known, key = quantities[part.unit], (part.distress, part.severity)
                known[key] = known.get(key, 0.0) + part.quantity
        return tuple(_condition(unit, known) for unit, known in zip(self.units, quantities, strict=True))

    def pci(self, found: Iterable[int] | None = None) -> float:
        """The condition index of all units together (`mean_pci`), by the defects as in `conditions`."""
        return self._whole_pci if found is None else mean_pci(self.conditions(found))

    @cached_property
    def _whole_pci(self) -> float:
        return mean_pci(self.conditions())


class MeasuredDefect(Protocol):
    """A defect as an inspection measured it, such as an entry of an inventory."""

    @property
    def class_name(self) -> str: ...
    @property
    def outline(self) -> Polygon | None:
        """World frame, metres; None where the place is not known."""
        ...

    @property
    def severities(self) -> Mapping[Severity, float]:
        """Possible severities, at least one, each with the part of the quantity that counts under it."""
        ...

    @property
    def length_m(self) -> float:
        """Length of a crack."""
        ...

    @property
    def width_m(self) -> float:
        """Mean diameter of a pothole."""
        ...

    @property
    def area_m2(self) -> float: ...


def measured_conditions(units: Sequence[SampleUnit], defects: Iterable[MeasuredDefect]) -> tuple[UnitCondition, ...]:
    """The condition of units by measured defects.

    Defects outside all units and classes without a distress do not count. A pothole counts in the unit where the
    middle of its outline lies, any other defect by the share of its outline in each unit.
    """
    quantities: list[dict[tuple[Distress, Severity], float]] = [{} for _ in units]
    tree = shapely.STRtree([unit.polygon for unit in units])
    distresses = {kind.name: kind.distress for kind in DEFECT_CLASSES.values()}
    for defect in defects:
        distress, outline = distresses.get(defect.class_name), defect.outline
        if distress is None or outline is None:
            continue
        near = tree.query(outline, predicate="intersects").tolist()
        if not near:
            continue
        shape = outline.centroid if distress.unit == "number" else outline
        shares = _shares(shape, [units[number].polygon for number in near])
        quantity = quantity_of(defect, distress)
        for (number, share), (severity, part) in product(zip(near, shares, strict=True), defect.severities.items()):
            known = quantities[number]
            known[distress, severity] = known.get((distress, severity), 0.0) + share * part * quantity
    return tuple(_condition(unit, known) for unit, known in zip(units, quantities, strict=True))


def mean_pci(conditions: Iterable[UnitCondition]) -> float:
    """The index of a segment, street or town: the mean of its units by area (ASTM D6433, section 10).

    Raises:
        ValueError: there is no unit.
    """
    known = list(conditions)
    if not known:
        raise ValueError("without a sample unit there is no condition index")
    area = sum(condition.unit.area_m2 for condition in known)
    return min(100.0, sum(condition.pci * condition.unit.area_m2 for condition in known) / area)


def quantity_of(defect: Defect | MeasuredDefect, distress: Distress) -> float:
    """Quantity of a distress that a defect counts as, in the distress's unit."""
    if distress.unit == "m":
        return defect.length_m
    if distress.unit == "number":
        wide = defect.width_m > WIDE_POTHOLE_M
        return pi / 4 * defect.width_m**2 / POTHOLE_AREA_M2 if wide else 1.0
    return defect.area_m2


def not_counted(defects: Iterable[Defect]) -> dict[str, int]:
    """Number of defects by class, for classes without a distress and classes that are not registered."""
    counted = {kind.name for kind in DEFECT_CLASSES.values() if kind.distress is not None}
    return dict(sorted(Counter(defect.kind for defect in defects if defect.kind not in counted).items()))


def _parts(units: Sequence[SampleUnit], defects: Iterable[Defect]) -> Iterator[tuple[Defect, tuple[_Part, ...]]]:
    of_segment: dict[str, list[int]] = {}
    for number, unit in enumerate(units):
        of_segment.setdefault(unit.segment.id, []).append(number)
    for unit in units:
        shapely.prepare(unit.polygon)
    distresses = {kind.name: kind.distress for kind in DEFECT_CLASSES.values()}
    for defect in defects:
        distress = distresses.get(defect.kind)
        near = of_segment.get(defect.segment)
        if distress is None or not near:
            continue
        shape = defect.centre if distress.unit == "number" else defect.polygon
        shares = _shares(shape, [units[number].polygon for number in near])
        quantity = quantity_of(defect, distress)
        yield (
            defect,
            tuple(
                _Part(number, distress, defect.severity, share * quantity)
                for number, share in zip(near, shares, strict=True)
                if share > 0
            ),
        )


def _shares(shape: Point | Polygon, polygons: Sequence[BaseGeometry]) -> list[float]:
    """The share of a defect's outline or centre in each of the polygons; they add up to 1."""
    within = [float(shapely.covers(polygon, shape)) for polygon in polygons]
    if sum(within) == 1.0:
        return within
    areas = [float(shapely.intersection(polygon, shape).area) for polygon in polygons]
    total = sum(areas)
    if total > 0:
        return [area / total for area in areas]
    distances = shapely.distance(np.array(polygons), shape)
    nearest = int(np.argmin(distances))  # of a centre on a cut, the first
    return [float(number == nearest) for number in range(len(polygons))]


def _condition(unit: SampleUnit, quantities: dict[tuple[Distress, Severity], float]) -> UnitCondition:
    deducts = []
    for distress, severity in product(Distress, Severity):
        if quantity := quantities.get((distress, severity), 0.0):
            density = 100 * quantity / unit.area_m2
            deducts.append(Deduct(distress, severity, quantity, density, deduct_value(distress, severity, density)))
    return UnitCondition(unit, tuple(deducts), pavement_condition_index(each.value for each in deducts))
