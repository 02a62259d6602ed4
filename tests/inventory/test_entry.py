"""One entry from several looks: what is combined, and with which error."""

from math import sqrt

import numpy as np
import pytest
from shapely import Point, Polygon

from pavetwin.detections import Detections
from pavetwin.inventory.entry import Entry
from scenes.observed import entry_of, observed


def look(
    x: float = 0.0, *, confidence: float = 0.5, severity: str = "", is_cut: bool = False, **sizes: float
) -> Detections:
    pixel_m = sizes.pop("pixel_m", 0.01)
    shape = Point(x, 0).buffer(0.25)
    assert isinstance(shape, Polygon)
    image = f"{x}-{confidence}-{sizes}"
    return observed(
        "single_crack", confidence, image, shape, severity=severity, pixel_m=pixel_m, is_cut=is_cut, **sizes
    )


def test_sizes_are_means_weighted_by_the_pixels() -> None:
    """The second look's pixels are twice as large, so that it counts a quarter."""
    entry = entry_of(1, [look(length_m=2.00, pixel_m=0.01), look(length_m=2.01, pixel_m=0.02)])
    assert entry.sizes["length_m"].value == pytest.approx((2.00 + 2.01 / 4) / 1.25)
    assert entry.sizes["length_m"].error == pytest.approx(0.01 / sqrt(2) / sqrt(1.25))


def test_an_area_is_uncertain_by_half_a_pixel_along_its_edge() -> None:
    """Of pixels of 1 cm: the edge of a crack is twice its length, that of 0.4 by 0.4 m is 1.6 m."""
    crack = entry_of(1, [look(area_m2=0.16, length_m=3.0, pixel_m=0.01)])
    assert crack.sizes["area_m2"].error == pytest.approx(0.5 * 0.01 * 6.0)
    assert crack.sizes["length_m"].error == pytest.approx(0.01 / sqrt(2))
    square = entry_of(1, [look(area_m2=0.16, pixel_m=0.01)])
    assert square.sizes["area_m2"].error == pytest.approx(0.5 * 0.01 * 1.6)


def test_looks_that_scatter_more_than_pixels_explain_have_a_larger_error() -> None:
    values = [1.0, 1.2, 1.4, 1.6]
    entry = entry_of(1, [look(length_m=value) for value in values])
    assert entry.sizes["length_m"].value == pytest.approx(1.3)
    assert entry.sizes["length_m"].error == pytest.approx(np.std(values, ddof=1) / sqrt(4))


def test_what_the_border_cuts_counts_only_where_nothing_whole_is_seen() -> None:
    whole, part = look(length_m=2.0), look(length_m=0.7, confidence=0.9, is_cut=True)
    entry = entry_of(1, [whole, part])
    assert entry.sizes["length_m"].value == 2.0
    assert (entry.is_cut, entry.looks, entry.confidence) == (False, 2, 0.9)
    assert entry.best == whole
    parts = entry_of(1, [part, look(1.0, length_m=1.1, is_cut=True)])
    assert parts.is_cut
    assert parts.sizes["length_m"].value == 1.1


def place(entry: Entry) -> tuple[float, float, float]:
    assert entry.place is not None
    assert entry.place_error_m is not None
    return entry.place.x, entry.place.y, entry.place_error_m


def test_the_place_is_the_mean_of_the_looks() -> None:
    assert place(entry_of(1, [look(0.0), look(0.01)])) == pytest.approx((0.005, 0.0, 0.01 / sqrt(2)), abs=1e-3)
    scattered = [look(x) for x in (-1.0, 0.0, 1.0)]
    assert place(entry_of(1, scattered)) == pytest.approx((0.0, 0.0, 1 / sqrt(3)), abs=1e-6)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (["low", "low to medium"], "low"),
        (["medium to high", "low to medium"], "medium"),
        (["low", "high"], ""),
        (["", ""], ""),
        (["high", "", "medium to high"], "high"),
        (["low to medium", "low to medium"], "low to medium"),
    ],
)
def test_the_severity_is_what_most_looks_allow(said: list[str], told: str) -> None:
    looks = [look(severity=each, confidence=0.5 + 0.01 * image) for image, each in enumerate(said)]
    assert entry_of(1, looks).severity == told


@pytest.mark.parametrize("name", ["mean_width_mm", "diameter_mm"])
def test_errors_of_sizes_in_millimetres_are_in_millimetres(name: str) -> None:
    """Two looks that differ by less than their pixels of 1 cm: the error is that of the pixels."""
    entry = entry_of(1, [look(**{name: 40.0}), look(1.0, **{name: 42.0})])
    assert entry.sizes[name].value == pytest.approx(41.0)
    assert entry.sizes[name].error == pytest.approx(10.0 / sqrt(2) / sqrt(2))
