"""Boxes by their laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.labels.boxes import area, moved, of_mask, ordered, scaled, share_within, to_pixels, within

SIDE = st.integers(1, 3000)
EDGE = st.floats(-2000, 4000, allow_nan=False)


@st.composite
def boxes_in_images(draw: st.DrawFn) -> tuple[tuple[int, int, int, int], tuple[int, int]]:
    """A box of whole pixels, and the image that it is in."""
    width, height = draw(SIDE), draw(SIDE)
    left, top = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    right, bottom = draw(st.integers(left + 1, width)), draw(st.integers(top + 1, height))
    return (left, top, right, bottom), (width, height)


@given(st.tuples(EDGE, EDGE, EDGE, EDGE), st.tuples(SIDE, SIDE))
def test_nothing_leaves_the_image_or_loses_its_area(box: tuple[float, ...], size: tuple[int, int]) -> None:
    left, top, right, bottom = ordered((box[0], box[1], box[2], box[3]))
    pixels = to_pixels((left, top, right, bottom), size)
    inside = within((left, top, right, bottom), (0, 0, *size))
    assert (pixels is None) == (inside is None)
    if pixels is not None and inside is not None:
        assert 0 <= pixels[0] < pixels[2] <= size[0]
        assert 0 <= pixels[1] < pixels[3] <= size[1]
        assert max(abs(edge - exact) for edge, exact in zip(pixels, inside, strict=True)) <= 1.0


@given(boxes_in_images())
def test_whole_pixels_stay_as_they_are(drawn: tuple[tuple[int, int, int, int], tuple[int, int]]) -> None:
    box, size = drawn
    assert to_pixels(box, size) == box


@given(boxes_in_images(), st.floats(0.05, 1.0), st.floats(0.05, 1.0))
def test_scaling_there_and_back(
    drawn: tuple[tuple[int, int, int, int], tuple[int, int]], across: float, down: float
) -> None:
    box, _ = drawn
    back = scaled(scaled(box, across, down), 1 / across, 1 / down)
    assert back == pytest.approx(box, rel=1e-9, abs=1e-9)
    assert area(scaled(box, across, down)) == pytest.approx(area(box) * across * down)


@given(boxes_in_images(), st.integers(1, 6), st.integers(1, 6))
def test_tiles_share_out_a_box(
    drawn: tuple[tuple[int, int, int, int], tuple[int, int]], columns: int, rows: int
) -> None:
    box, (width, height) = drawn
    across, down = [width * i / columns for i in range(columns + 1)], [height * i / rows for i in range(rows + 1)]
    tiles = [(across[i], down[j], across[i + 1], down[j + 1]) for i in range(columns) for j in range(rows)]
    assert sum(share_within(box, tile) for tile in tiles) == pytest.approx(1.0)
    for left, top, right, bottom in tiles:
        inside = within(box, (left, top, right, bottom))
        if inside is not None:
            seen = moved(inside, -left, -top)
            assert min(seen) >= 0
            assert seen[2] <= right - left + 1e-9
            assert seen[3] <= bottom - top + 1e-9
            assert moved(seen, left, top) == pytest.approx(inside)


def test_a_box_thinner_than_a_pixel_gets_the_pixel_of_its_middle() -> None:
    assert to_pixels((3.1, 0.2, 3.3, 9.0), (10, 10)) == (3, 0, 4, 9)
    assert to_pixels((9.9, 9.9, 10.0, 10.0), (10, 10)) == (9, 9, 10, 10)


@given(boxes_in_images())
def test_the_box_of_a_mask_encloses_its_pixels_and_no_more(
    box_and_size: tuple[tuple[int, ...], tuple[int, int]],
) -> None:
    (left, top, right, bottom), size = box_and_size
    mask = np.zeros(size[::-1], dtype=np.bool_)
    assert of_mask(mask) is None
    mask[top, left] = mask[bottom - 1, right - 1] = True
    assert of_mask(mask) == (left, top, right, bottom)
