"""Severity of drawn masks: what two pixels can decide, and what no mask tells."""

import cv2
import numpy as np
import pytest

from pavetwin.detections import NOT_RESOLVABLE
from pavetwin.perception.measuring import visible_severity


def crack(width_mm: float, gsd_mm: float) -> np.ndarray:
    """A straight crack of 1 m with an opening, marked 2 cm beyond its edges as labels are."""
    return np.ones((round((width_mm + 40) / gsd_mm), round(1000 / gsd_mm)), dtype=bool)


def hole(diameter_mm: float, gsd_mm: float) -> np.ndarray:
    radius = (diameter_mm + 40) / 2 / gsd_mm
    mask = np.zeros((2 * int(radius) + 5,) * 2, np.uint8)
    cv2.circle(mask, (int(radius) + 2,) * 2, round(radius), 1, thickness=-1)
    return mask.astype(bool)


@pytest.mark.parametrize(
    ("width_mm", "gsd_mm", "told"),
    [
        (3.0, 0.5, "low"),
        (30.0, 2.0, "medium"),
        (120.0, 4.0, "high"),
        (10.0, 2.0, "low to medium"),  # the limit of 10 mm lies within two pixels
        (74.0, 2.0, "medium to high"),
        (30.0, 40.0, NOT_RESOLVABLE),
    ],
)
def test_a_crack_by_its_opening(width_mm: float, gsd_mm: float, told: str) -> None:
    assert visible_severity("single_crack", crack(width_mm, gsd_mm), gsd_mm) == told


def test_a_coarse_mask_decides_less() -> None:
    mask = crack(30.0, 2.0)
    assert visible_severity("single_crack", mask, 2.0, cell_px=1.0) == "medium"
    assert visible_severity("single_crack", mask, 2.0, cell_px=8.0) == "low to medium"
    assert visible_severity("single_crack", mask, 2.0, cell_px=20.0) == NOT_RESOLVABLE


@pytest.mark.parametrize(
    ("diameter_mm", "told"),
    [
        (120.0, "low to medium"),
        (320.0, "low to medium"),
        (450.0, NOT_RESOLVABLE),  # between a size that no depth makes high and one that no depth makes low
        (600.0, "medium to high"),
        (1100.0, "medium to high"),
    ],
)
def test_a_pothole_by_its_diameter_at_any_depth(diameter_mm: float, told: str) -> None:
    assert visible_severity("pothole", hole(diameter_mm, 2.5), 2.5) == told


def test_a_network_of_cracks_shows_no_severity() -> None:
    assert visible_severity("crocodile_crack", np.ones((200, 300), dtype=bool), 2.0) == NOT_RESOLVABLE
