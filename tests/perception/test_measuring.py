"""Sizes and severity of drawn masks whose sizes are known."""

from itertools import pairwise
from math import isnan

import cv2
import numpy as np
import pytest

from pavetwin.detections import NOT_RESOLVABLE
from pavetwin.perception.measuring import measured, visible_severity

GSD_MM = 2.5


def strip(points: list[tuple[int, int]], width: int) -> np.ndarray:
    mask = np.zeros((200, 300), np.uint8)
    cv2.polylines(mask, [np.array(points)], isClosed=False, color=1, thickness=width)
    return mask.astype(bool)


@pytest.mark.parametrize(
    ("points", "width"),
    [
        ([(20, 50), (270, 50)], 5),
        ([(20, 20), (180, 180)], 7),
        ([(20, 20), (120, 60), (140, 150), (280, 180)], 5),
    ],
)
def test_a_crack_has_its_length_and_width_however_it_bends(points: list[tuple[int, int]], width: int) -> None:
    mask = strip(points, width)
    told = measured("single_crack", mask, GSD_MM)
    length = sum(np.hypot(*np.subtract(*pair)) for pair in pairwise(points)) + width
    assert told["length_m"] == pytest.approx(length * GSD_MM / 1000, rel=0.08)
    assert told["mean_width_mm"] == pytest.approx(mask.sum() / length * GSD_MM, rel=0.08)
    assert told["area_m2"] == pytest.approx(mask.sum() * GSD_MM**2 / 1e6, abs=1e-4)


def test_a_rectangle_has_its_own_sides() -> None:
    told = measured("single_crack", np.ones((8, 20), bool), GSD_MM)
    assert (told["length_m"], told["mean_width_mm"]) == pytest.approx((20 * GSD_MM / 1000, 8 * GSD_MM), rel=0.01)


def test_a_pothole_has_the_diameter_of_its_disc() -> None:
    rows, columns = np.mgrid[:100, :100]
    mask = np.hypot(rows - 50, columns - 50) < 30
    assert measured("pothole", mask, GSD_MM)["diameter_mm"] == pytest.approx(60 * GSD_MM, rel=0.01)


def test_what_is_narrower_than_two_pixels_has_no_width() -> None:
    told = measured("single_crack", strip([(20, 50), (270, 50)], 1), GSD_MM)
    assert isnan(told["mean_width_mm"])
    assert told["length_m"] == pytest.approx(250 * GSD_MM / 1000, rel=0.02)
    assert isnan(measured("pothole", np.ones((1, 1), bool), GSD_MM)["area_m2"])


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
