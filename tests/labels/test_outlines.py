"""Polygons of masks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

from pavetwin.labels import outlines
from pavetwin.labels.outlines import boundary, outline


def filled(polygon: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The mask (height, width) of a polygon, by Pillow: even-odd, border included."""
    image = Image.new("1", (shape[1], shape[0]))
    ImageDraw.Draw(image).polygon([(int(x), int(y)) for x, y in polygon], fill=1, outline=1)
    return np.array(image)


def overlap(one: np.ndarray, other: np.ndarray) -> float:
    return float((one & other).sum() / (one | other).sum())


@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))).filter(np.any))
def test_the_corners_lie_in_the_mask_and_span_its_box(mask: np.ndarray) -> None:
    polygon = outline(mask)
    assert len(polygon) >= 3
    assert np.ptp(polygon, axis=0).min() > 0
    columns, rows = polygon.astype(int).T
    assert mask[rows, columns].all()
    rows, columns = np.nonzero(mask)
    assert polygon.min(axis=0).astype(int).tolist() == [columns.min(), rows.min()]
    assert polygon.max(axis=0).astype(int).tolist() == [columns.max(), rows.max()]
    assert filled(polygon, mask.shape)[mask].mean() > 0.8


@pytest.mark.parametrize(("blur_px", "least"), [(8.0, 0.98), (3.0, 0.95)])
def test_a_polygon_filled_is_the_mask(blur_px: float, least: float) -> None:
    """Blots with holes, in several parts."""
    noise = gaussian_filter(np.random.default_rng(1).random((160, 200)), blur_px)
    mask = noise > np.quantile(noise, 0.6)
    assert overlap(filled(outline(mask), mask.shape), mask) > least


def test_a_network_of_cracks_is_not_filled_in() -> None:
    mask = np.zeros((100, 100), dtype=bool)
    mask[5::20, 5:90] = mask[6::20, 5:90] = mask[5:90, 5::20] = mask[5:90, 6::20] = True
    assert overlap(filled(outline(mask), mask.shape), mask) > 0.99


def test_parts_are_joined_by_the_shortest_bridges() -> None:
    mask = np.zeros((20, 60), dtype=bool)
    mask[5:15, 5:15] = mask[5:15, 18:28] = mask[5:15, 45:55] = True
    extra = filled(outline(mask), mask.shape) & ~mask
    assert extra.sum() == 3 + 17


@pytest.mark.parametrize("shape", [(1, 1), (1, 20), (20, 1)])
def test_a_line_of_pixels_has_an_area(shape: tuple[int, int]) -> None:
    mask = np.ones(shape, dtype=bool)
    polygon = outline(mask)
    assert np.ptp(polygon, axis=0).min() == pytest.approx(0.9)
    assert filled(polygon, shape).all()


def blots() -> st.SearchStrategy[np.ndarray]:
    return arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))).filter(np.any)


@given(blots())
def test_a_boundary_filled_is_exactly_the_mask(mask: np.ndarray) -> None:
    """Also of several parts, holes, and pixels that touch at a corner."""
    polygon = boundary(mask)
    assert (outlines.filled(polygon, mask.shape[::-1]) == mask).all()
    rows, columns = np.nonzero(mask)
    assert (*polygon.min(axis=0), *polygon.max(axis=0)) == (
        columns.min(),
        rows.min(),
        columns.max() + 1,
        rows.max() + 1,
    )


def test_a_pixel_is_in_a_polygon_with_its_middle() -> None:
    triangle = np.array([(-3.0, -3.0), (9.0, -3.0), (-3.0, 9.0)])  # beyond the image on two sides
    rows, columns = np.mgrid[0:4, 0:5]
    assert (outlines.filled(triangle, (5, 4)) == (columns + rows + 1 < 6)).all()
    assert not outlines.filled(np.array([(1.6, 0.0), (2.4, 0.0), (2.4, 4.0), (1.6, 4.0)]), (5, 4)).any()
