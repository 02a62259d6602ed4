"""Sizes of drawn masks whose sizes are known."""

from itertools import pairwise
from math import isnan

import cv2
import numpy as np
import pytest

from pavetwin.perception.measuring import measured

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
