"""The laws of the curves and of the index."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pavetwin.defects.severity import Distress
from pavetwin.pci.curves import DEDUCT_POINTS, corrected_deduct_value, deduct_value
from pavetwin.pci.index import Rating, pavement_condition_index, rating_of
from pavetwin.world.model import Severity

VALUES = st.lists(st.floats(0.0, 100.0), max_size=14)


def test_every_distress_has_its_charts() -> None:
    assert set(DEDUCT_POINTS) == set(Distress)
    for densities, *curves in DEDUCT_POINTS.values():
        assert list(densities) == sorted(densities)
        assert [len(curve.split()) for curve in curves] == [len(densities)] * len(Severity)


@given(st.sampled_from(Distress), st.floats(0.0, 200.0), st.floats(0.0, 200.0))
def test_more_of_a_distress_takes_no_less(distress: Distress, one: float, other: float) -> None:
    less, more = sorted((one, other))
    for severity in Severity:
        assert 0.0 <= deduct_value(distress, severity, less) <= deduct_value(distress, severity, more) <= 100.0


@given(st.sampled_from(Distress), st.floats(0.0, 200.0))
@example(Distress.BLOCK_CRACKING, 0.25)  # between points that the charts share
def test_a_worse_severity_takes_no_less(distress: Distress, density: float) -> None:
    low, medium, high = (deduct_value(distress, severity, density) for severity in Severity)
    assert low <= medium <= high


@given(VALUES)
def test_an_index_is_within_its_scale_and_does_not_depend_on_the_order(values: list[float]) -> None:
    index = pavement_condition_index(values)
    assert 0.0 <= index <= 100.0
    assert index == pavement_condition_index(values[::-1])


@given(st.floats(0.0, 100.0))
def test_a_single_value_is_taken_whole(value: float) -> None:
    assert pavement_condition_index([value]) == pytest.approx(100.0 - value)


@given(VALUES.filter(bool))
def test_several_take_at_least_the_highest_and_at_most_their_sum(values: list[float]) -> None:
    index = pavement_condition_index(values)
    assert max(0.0, 100.0 - sum(values)) - 1e-9 <= index <= 100.0 - max(values) + 1e-9


@given(st.floats(0.0, 250.0), st.integers(1, 11))
def test_the_same_total_of_more_values_takes_no_more(total: float, q: int) -> None:
    assert corrected_deduct_value(total, q + 1) <= corrected_deduct_value(total, q) + 0.5


def test_nothing_takes_nothing() -> None:
    assert pavement_condition_index([]) == 100.0
    assert all(deduct_value(distress, severity, 0.0) == 0.0 for distress in Distress for severity in Severity)
    with pytest.raises(ValueError, match="below 0"):
        deduct_value(Distress.POTHOLES, Severity.LOW, -1.0)


def test_ratings_begin_at_their_limits() -> None:
    limits = {100: "good", 85: "good", 84.9: "satisfactory", 70: "satisfactory", 55: "fair", 54.9: "poor", 40: "poor"}
    limits |= {25: "very poor", 10: "serious", 9.9: "failed", 0: "failed"}
    assert {pci: rating_of(pci).value for pci in limits} == limits
    assert len(Rating) == 7
    with pytest.raises(ValueError, match="not within"):
        rating_of(100.1)
