"""The condition index by what an inspection measured."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from pavetwin.pci import Survey, mean_pci, measured_conditions, sample_units
from pavetwin.world.model import Defect, Severity
from scenes import damaged, tiny

EVERY = tuple(Severity)


@dataclass(frozen=True)
class Measured:
    class_name: str
    outline: Polygon | None
    severities: Mapping[Severity, float]
    length_m: float
    width_m: float
    area_m2: float


def measured(defect: Defect, **changes: object) -> Measured:
    """A defect measured without error."""
    exact = Measured(
        *(defect.kind, defect.polygon, {defect.severity: 1.0}), defect.length_m, defect.width_m, defect.area_m2
    )
    return replace(exact, **changes)  # type: ignore[arg-type]


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    shape = shapely.box(x0, y0, x1, y1)
    assert isinstance(shape, Polygon)
    return shape


def test_exact_measures_give_the_true_index() -> None:
    world = damaged("cross", 8).world
    units = sample_units(world.segments)
    conditions = measured_conditions(units, [measured(each) for each in world.defects])
    true = Survey(units, world.defects).conditions()
    assert mean_pci(conditions) == pytest.approx(mean_pci(true), abs=0.5)
    apart = [abs(mine.pci - its.pci) for mine, its in zip(conditions, true, strict=True)]
    assert sum(apart) / len(apart) < 1.0


def test_what_lies_on_no_inspected_road_and_other_classes_do_not_count() -> None:
    world = tiny.straight((30, 0))
    units = sample_units(world.segments)
    beside = measured(world.defects[0], outline=box(30, 90, 31, 91))
    other = measured(world.defects[0], class_name="frost_heave")
    nowhere = measured(world.defects[0], outline=None)
    conditions = measured_conditions(units, [beside, other, nowhere])
    assert [each.pci for each in conditions] == [100.0] * len(units)


def test_a_severity_that_is_not_shown_counts_in_parts() -> None:
    world = tiny.straight((30, 0))
    units = sample_units(world.segments)
    hole = measured(world.defects[0], severities=dict(zip(EVERY, (0.5, 0.3, 0.2), strict=True)))
    deducts = [deduct for each in measured_conditions(units, [hole]) for deduct in each.deducts]
    assert [each.severity for each in deducts] == list(EVERY)
    assert [each.quantity for each in deducts] == pytest.approx([0.5, 0.3, 0.2])


@given(st.floats(0.5, 60.0), st.floats(0.0, 1.0))
def test_a_crack_over_two_units_counts_once(length_m: float, share: float) -> None:
    world = tiny.straight(length_m=120.0, width_m=7.0)
    units = sample_units(world.segments)
    assert len(units) > 1
    x0 = 60.0 - share * length_m
    crack = Measured(
        "single_crack", box(x0, 0.0, x0 + length_m, 0.05), {Severity.LOW: 1.0}, length_m, 0.05, 0.05 * length_m
    )
    conditions = measured_conditions(units, [crack])
    assert sum(deduct.quantity for each in conditions for deduct in each.deducts) == pytest.approx(length_m, rel=1e-6)
