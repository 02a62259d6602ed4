"""Published worked examples of ASTM D6433: deduct values, their correction, and the index, as people read charts.

People read a chart to a point or two; an index from densities has several readings in it.
"""

import pytest

from pavetwin.defects.severity import Distress
from pavetwin.pci.curves import FOOT_M, corrected_deduct_value, deduct_value
from pavetwin.pci.index import allowed_number, pavement_condition_index
from pavetwin.world.model import Severity

L, M, H = Severity.LOW, Severity.MEDIUM, Severity.HIGH

STANDARD = (
    (Distress.ALLIGATOR_CRACKING, L, 0.52, 7.9),
    (Distress.ALLIGATOR_CRACKING, H, 0.56, 23.4),
    (Distress.EDGE_CRACKING, L, 5.20, 7.5),
    (Distress.JOINT_REFLECTION_CRACKING, M, 5.72, 25.1),
    (Distress.PATCHING, H, 0.88, 17.9),
    (Distress.POTHOLES, L, 0.04, 11.2),
    (Distress.RUTTING, L, 0.84, 6.9),
    (Distress.RAVELING, L, 10.0, 5.3),
)
"""ASTM D6433-07, figures 4 and 6: one sample unit of 2,500 ft². Densities are those of its feet."""

KERTOSONO_1 = (
    (Distress.ALLIGATOR_CRACKING, L, 0.22, 5),
    (Distress.SHOVING, L, 0.81, 4),
    (Distress.PATCHING, M, 1.97, 14),
)
KERTOSONO_21 = (
    (Distress.ALLIGATOR_CRACKING, L, 0.65, 8),
    (Distress.ALLIGATOR_CRACKING, M, 3.27, 35),
    (Distress.BLOCK_CRACKING, L, 1.72, 3),
    (Distress.PATCHING, M, 8.03, 28),
)
"""Sample units 1 and 21, of 350 m² each, of a survey of the road from Kertosono to Kediri (2023, 123dok.com, y6enpo74).
Only areas: their densities do not depend on the unit of length."""


def in_metres(distress: Distress, density: float) -> float:
    """A density of the standard's charts, in feet, as one in metres."""
    return density / {"m": FOOT_M, "number": FOOT_M**2}.get(distress.unit, 1.0)


@pytest.mark.parametrize(("distress", "severity", "density", "read"), [*STANDARD, *KERTOSONO_1, *KERTOSONO_21])
def test_deduct_values_are_those_that_were_read_from_the_charts(
    distress: Distress, severity: Severity, density: float, read: float
) -> None:
    assert deduct_value(distress, severity, in_metres(distress, density)) == pytest.approx(read, abs=2.1)


@pytest.mark.parametrize(
    ("values", "published"),
    [
        ([row[3] for row in STANDARD], 49),
        ([48, 23, 18, 6, 5.0], 40),  # Mslata road, Libya: a thesis of Diponegoro University, table 4.3
        ([14, 5, 4], 82),
        ([22, 19, 14, 9, 7], 63),
        ([35, 28, 8, 3], 51),
    ],
)
def test_the_index_of_published_deduct_values(values: list[float], published: int) -> None:
    assert pavement_condition_index(values) == pytest.approx(published, abs=1.5)


@pytest.mark.parametrize(
    ("examples", "published"), [(STANDARD, 49), (KERTOSONO_1, 82), (KERTOSONO_21, 51)], ids=["standard", "1", "21"]
)
def test_the_index_from_densities(
    examples: tuple[tuple[Distress, Severity, float, float], ...], published: int
) -> None:
    values = [
        deduct_value(distress, severity, in_metres(distress, density)) for distress, severity, density, _ in examples
    ]
    assert pavement_condition_index(values) == pytest.approx(published, abs=2.5)


@pytest.mark.parametrize(
    ("total", "q", "read"),
    [
        (71, 5, 36),
        (66, 4, 37),
        (59, 3, 37),
        (47, 2, 33),
        (30, 1, 30),
        (74, 4, 41),
        (23, 3, 12),
        (21, 2, 15),
        (18, 1, 18),
    ],
)
def test_corrected_deduct_values_are_those_that_were_read(total: float, q: int, read: float) -> None:
    assert corrected_deduct_value(total, q) == pytest.approx(read, abs=2.0)


def test_how_many_deduct_values_count() -> None:
    assert allowed_number(25.1) == pytest.approx(7.88, abs=0.01)  # the standard's 7.9
    assert allowed_number(48) == pytest.approx(5.77, abs=0.01)  # of which the last 0.77 of a value
    assert allowed_number(0.0) == 10.0
