"""The ground resolution of a road by the width of its lane lines, and what is none of them."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from pavetwin.arrays import UInt8Array
from pavetwin.datasets.markings import marking_gsd_mm
from pavetwin.datasets.placing import road_mask
from scenes.photographs import pavement

SIZE = (400, 400)


def drawn(*rectangles: tuple[float, float, float, float], angle_deg: float = 0.0, grey: int = 210) -> UInt8Array:
    """Pavement with bright strips (left, top, right, bottom), turned about its middle."""
    mask = Image.new("L", (4 * SIZE[0], 4 * SIZE[1]))
    for each in rectangles:
        ImageDraw.Draw(mask).rectangle([4 * side for side in each], fill=255)
    share = np.asarray(mask.rotate(angle_deg, Image.Resampling.BICUBIC).resize(SIZE, Image.Resampling.BOX)) / 255
    picture = pavement(SIZE) * (1 - share[..., None]) + grey * share[..., None]
    return picture.astype(np.uint8)


def estimated(picture: UInt8Array) -> float | None:
    return marking_gsd_mm(picture, road_mask(picture))


@pytest.mark.parametrize(("width", "angle"), [(8, 0.0), (8, 33.0), (15, 90.0), (24, -20.0)])
def test_a_lane_line_is_fifteen_centimetres_wide(width: int, angle: float) -> None:
    assert estimated(drawn((200, 80, 200 + width, 320), angle_deg=angle)) == pytest.approx(150 / width, rel=0.1)


def test_of_several_lines_the_middle_one_counts() -> None:
    lines = [(80 * at, 60, 80 * at + width, 340) for at, width in enumerate((8, 10, 15), start=1)]
    assert estimated(drawn(*lines)) == pytest.approx(15, rel=0.1)


def test_without_lane_lines_nothing_is_known() -> None:
    bars = [(60 + 40 * at, 100, 75 + 40 * at, 260) for at in range(7)]
    assert estimated(drawn(*bars[:1])) is not None
    assert estimated(drawn(*bars)) is None, "bars of a crossing"
    assert estimated(pavement(SIZE)) is None
    assert estimated(drawn((150, 150, 190, 250))) is None, "not slender"
    assert estimated(drawn((200, 190, 203, 225))) is None, "short"
    assert estimated(drawn((200, 80, 212, 320), grey=140)) is None, "hardly brighter than the road"


@pytest.mark.parametrize("beyond", [(60, 110, 40), (165, 165, 165)])
def test_a_kerb_is_no_lane_line(beyond: tuple[int, int, int]) -> None:
    picture = drawn((200, 0, 215, 400))
    assert estimated(picture) is not None
    picture[:, 216:] = beyond
    assert estimated(picture) is None
