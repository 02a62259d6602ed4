"""A survey: the distresses and the condition index of sample units, from defects."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import pi
from typing import Final

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.defects.severity import Distress
from pavetwin.pci.curves import deduct_value
from pavetwin.pci.index import Deduct, Rating, pavement_condition_index, rating_of
from pavetwin.pci.sample_units import SampleUnit
from pavetwin.world.model import Defect, Severity

WIDE_POTHOLE_M: Final = 0.75
POTHOLE_AREA_M2: Final = 0.5
"""A pothole wider than 0.75 m counts as many as its area holds of these (ASTM D6433, X1.13)."""


@dataclass(frozen=True, slots=True)
class UnitCondition:
    """A sample unit as surveyed."""

    unit: SampleUnit
    deducts: tuple[Deduct, ...]
    """By distress and severity."""
    pci: float
    """0 (failed) to 100 (without distress)."""

    @property
    def rating(self) -> Rating:
        return rating_of(self.pci)


@dataclass(frozen=True, slots=True)
class _Part:
    """What a defect is of a distress in a unit."""

    unit: int
    distress: Distress
    severity: Severity
    quantity: float


class Survey:
    """The units of segments with all that their defects come to, so that the condition is quick to tell of some of
    the defects: of those that were found.

    A defect that lies in several units counts in each by the share of its outline there; a pothole counts where its
    centre lies. Defects of classes that stand for no distress or are not registered here, and those of other segments,
    do not count.
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
        """The condition index of all units together, see `mean_pci`; of what is known, as in `conditions`."""
        return self._whole_pci if found is None else mean_pci(self.conditions(found))

    @cached_property
    def _whole_pci(self) -> float:
        return mean_pci(self.conditions())


@dataclass(frozen=True, slots=True)
class MeasuredDefect:
    """A defect as an inspection measured it."""

    kind: str
    """Its class, such as `pothole`."""
    outline: Polygon
    """World frame, metres."""
    severities: Mapping[Severity, float]
    """Those that its images allow, at least one, each with the part of its quantity that counts under it."""
    length_m: float
    """Length of a crack."""
    width_m: float
    """Mean diameter of a pothole."""
    area_m2: float


def measured_conditions(
    units: Sequence[SampleUnit], defects: Iterable[MeasuredDefect]
) -> tuple[tuple[UnitCondition, ...], int]:
    """The condition of units by what was measured, and how many of the defects count in them.

    What lies in no unit does not count, nor do classes that stand for no distress. A pothole counts in the unit where
    the middle of its outline lies, any other by the share of its outline in each unit.
    """
    quantities: list[dict[tuple[Distress, Severity], float]] = [{} for _ in units]
    tree = shapely.STRtree([unit.polygon for unit in units])
    distresses = {kind.name: kind.distress for kind in DEFECT_CLASSES.values()}
    counted = 0
    for defect in defects:
        distress = distresses.get(defect.kind)
        near = tree.query(defect.outline, predicate="intersects").tolist()
        if distress is None or not near:
            continue
        shape = defect.outline.centroid if distress.unit == "number" else defect.outline
        shares = _shares(shape, [units[number].polygon for number in near])
        quantity = quantity_of(defect, distress)
        counted += 1
        for (number, share), (severity, part) in product(zip(near, shares, strict=True), defect.severities.items()):
            known = quantities[number]
            known[distress, severity] = known.get((distress, severity), 0.0) + share * part * quantity
    return tuple(_condition(unit, known) for unit, known in zip(units, quantities, strict=True)), counted


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


def quantity_of(defect: "Defect | MeasuredDefect", distress: Distress) -> float:
    """How much of a distress a defect is, in the distress's unit."""
    if distress.unit == "m":
        return defect.length_m
    if distress.unit == "number":
        wide = defect.width_m > WIDE_POTHOLE_M
        return pi / 4 * defect.width_m**2 / POTHOLE_AREA_M2 if wide else 1.0
    return defect.area_m2


def not_counted(defects: Iterable[Defect]) -> dict[str, int]:
    """How many defects are of classes that stand for no distress or are not registered here, by class."""
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
