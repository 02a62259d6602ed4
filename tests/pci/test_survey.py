"""Sample units, and what defects come to in them."""

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.defects.severity import Distress
from pavetwin.pci import Survey, mean_pci, pavement_condition_index, sample_units
from pavetwin.pci.curves import deduct_value
from pavetwin.pci.survey import quantity_of
from pavetwin.world.model import Defect, Severity
from scenes import damaged, tiny

CRACKING, ALLIGATOR = Distress.LONGITUDINAL_AND_TRANSVERSE_CRACKING, Distress.ALLIGATOR_CRACKING


def strip(number: int, x0: float, x1: float, kind: str, severity: Severity = Severity.LOW) -> Defect:
    """A defect along the middle of the usual street, as long as its outline and 10 cm wide."""
    like = tiny.defect(number, (x0 + x1) / 2, 0.0)
    return replace(like, kind=kind, polygon=shapely.box(x0, -0.05, x1, 0.05), severity=severity, length_m=x1 - x0)


@given(st.floats(5.0, 400.0), st.floats(2.5, 20.0))
def test_units_tile_their_segment_in_the_size_of_the_standard(length_m: float, width_m: float) -> None:
    (segment,) = tiny.straight(length_m=length_m, width_m=width_m).segments
    units = sample_units([segment])
    assert sum(unit.area_m2 for unit in units) == pytest.approx(segment.area_m2)
    assert shapely.union_all([unit.polygon for unit in units]).area == pytest.approx(segment.area_m2)
    assert all(unit.area_m2 <= 315.0001 for unit in units)
    if segment.area_m2 >= 135.0001:
        assert all(unit.has_usual_size for unit in units)
    else:
        assert [unit.has_usual_size for unit in units] == [False]
    assert [unit.id for unit in units] == [f"{segment.id}-{number}" for number in range(1, len(units) + 1)]
    along = [segment.centre_line.project(unit.polygon.centroid) for unit in units]
    assert along == sorted(along)


def test_units_of_bent_and_real_segments_tile_them() -> None:
    for world in (tiny.bent(), damaged("cross").world):
        for segment in world.segments:
            units = sample_units([segment])
            assert sum(unit.area_m2 for unit in units) == pytest.approx(segment.area_m2)


def test_a_crack_over_a_cut_counts_in_both_units_and_a_pothole_where_its_centre_is() -> None:
    world = tiny.straight(length_m=60.0, width_m=7.5)  # 450 m²: two units, cut at 30 m
    units = sample_units(world.segments)
    defects = [
        strip(0, 27.0, 31.0, "single_crack"),
        strip(1, 22.0, 38.0, "crocodile_crack", Severity.HIGH),
        tiny.defect(2, 29.9, 1.0),
    ]
    first, second = Survey(units, defects).conditions()
    quantities = [{(d.distress, d.severity): d.quantity for d in each.deducts} for each in (first, second)]
    assert quantities[0] == pytest.approx(
        {(ALLIGATOR, Severity.HIGH): 0.8, (CRACKING, Severity.LOW): 3.0, (Distress.POTHOLES, Severity.MEDIUM): 1.0}
    )
    assert quantities[1] == pytest.approx({(ALLIGATOR, Severity.HIGH): 0.8, (CRACKING, Severity.LOW): 1.0})
    by_hand = (
        deduct_value(ALLIGATOR, Severity.HIGH, 100 * 0.8 / 225),
        deduct_value(CRACKING, Severity.LOW, 100 * 3.0 / 225),
        deduct_value(Distress.POTHOLES, Severity.MEDIUM, 100 / 225),
    )
    assert first.pci == pytest.approx(pavement_condition_index(by_hand))
    assert second.pci > first.pci
    assert mean_pci([first, second]) == pytest.approx((first.pci + second.pci) / 2)


def test_quantities_of_one_severity_add_up_before_the_chart_is_read() -> None:
    world = tiny.straight(length_m=30.0, width_m=7.5)
    cracks = [strip(number, 1.0 + number, 1.9 + number, "single_crack") for number in range(10)]
    (together,) = Survey(sample_units(world.segments), cracks).conditions()
    (deduct,) = together.deducts
    assert (deduct.quantity, deduct.density) == (pytest.approx(9.0), pytest.approx(4.0))
    assert together.pci == pytest.approx(100 - deduct_value(CRACKING, Severity.LOW, 4.0))


def test_a_wide_pothole_counts_as_several() -> None:
    assert quantity_of(tiny.defect(0, 10.0, 0.0, side_m=0.75), Distress.POTHOLES) == 1.0
    assert quantity_of(tiny.defect(0, 10.0, 0.0, side_m=2.0), Distress.POTHOLES) == pytest.approx(math.pi / 0.5)


def test_what_is_not_found_is_not_in_the_index() -> None:
    world = damaged("cross").world
    survey = Survey(sample_units(world.segments), world.defects)
    every = [defect.id for defect in world.defects]
    assert survey.pci(every) == survey.pci()
    assert survey.pci([]) == pytest.approx(100.0)
    half = survey.conditions(every[::2])
    assert survey.pci() < mean_pci(half) < 100.0
    assert all(some.pci >= all_.pci - 1e-9 for some, all_ in zip(half, survey.conditions(), strict=True))


def test_defects_of_other_segments_and_of_no_distress_do_not_count() -> None:
    world = tiny.bent()
    (unit, *_) = sample_units(world.segments)
    assert Survey([unit], [defect for defect in world.defects if defect.segment == "side"]).pci() == 100.0
    assert Survey([unit], [replace(world.defects[0], kind="of_a_plugin_that_is_not_here")]).pci() == 100.0


def test_no_units_have_no_index() -> None:
    with pytest.raises(ValueError, match="without a sample unit"):
        mean_pci([])
