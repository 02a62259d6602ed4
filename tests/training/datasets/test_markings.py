"""The ground resolution of a road by the width of painted lines, and what is none of them."""

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageFilter

from pavetwin.arrays import UInt8Array
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.styles import street_style
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.view import look
from pavetwin.training.datasets.road import marking_gsd_mm, painted_lines
from pavetwin.uav.cameras import find_camera
from scenes import built
from scenes.photographs import pavement

SIZE = (400, 400)
GAMMA, LENS_PX = 2.2, 0.8
"""Cameras blur light and store its root."""
WHITE, YELLOW, ORANGE = (210, 210, 210), (214, 160, 40), (235, 110, 30)


def drawn(
    *rectangles: tuple[float, float, float, float], angle_deg: float = 0.0, colour: tuple[int, int, int] = WHITE
) -> UInt8Array:
    """Pavement with strips (left, top, right, bottom), turned about its middle, as a camera sees them."""
    mask = Image.new("L", (4 * SIZE[0], 4 * SIZE[1]))
    for left, top, right, bottom in rectangles:
        ImageDraw.Draw(mask).rectangle([4 * left, 4 * top, 4 * right - 1, 4 * bottom - 1], fill=255)
    seen = mask.rotate(angle_deg, Image.Resampling.BICUBIC).filter(ImageFilter.GaussianBlur(4 * LENS_PX))
    share = np.asarray(seen.resize(SIZE, Image.Resampling.BOX)) / 255
    road, paint = ((np.asarray(each) / 255) ** GAMMA for each in (pavement(SIZE), colour))
    light = road * (1 - share[..., None]) + paint * share[..., None]
    return np.round(255 * light ** (1 / GAMMA)).astype(np.uint8)


@settings(max_examples=10)
@given(st.floats(8.0, 40.0), st.floats(-90.0, 90.0), st.sampled_from([WHITE, YELLOW]))
def test_a_lane_line_is_fifteen_centimetres_wide(width: float, angle: float, colour: tuple[int, int, int]) -> None:
    picture = drawn((200 - width / 2, -100, 200 + width / 2, 500), angle_deg=angle, colour=colour)
    found = marking_gsd_mm(picture)
    assert found is not None
    assert 150 / found == pytest.approx(width, abs=0.5), "half a pixel"


def test_lines_may_have_another_width() -> None:
    assert marking_gsd_mm(drawn((200, 80, 212, 320)), line_m=0.12) == pytest.approx(10, rel=0.04)


def test_of_several_lines_the_middle_one_counts() -> None:
    lines = [(80 * at, 60, 80 * at + width, 340) for at, width in enumerate((8, 10, 15), start=1)]
    assert marking_gsd_mm(drawn(*lines)) == pytest.approx(15, rel=0.04)


def test_a_worn_line_is_as_wide_as_it_was() -> None:
    picture = drawn((200, 40, 216, 360))
    picture[120:135, 200:212] = picture[120:135, 100:112]
    picture[220:226] = picture[220:226, :1]
    assert marking_gsd_mm(picture) == pytest.approx(150 / 16, rel=0.04)


def test_what_is_no_line_tells_nothing() -> None:
    assert marking_gsd_mm(pavement(SIZE)) is None
    assert marking_gsd_mm(drawn((150, 150, 190, 250))) is None, "not slender"
    assert marking_gsd_mm(drawn((200, 190, 203, 225))) is None, "short"
    assert marking_gsd_mm(drawn((200, 80, 212, 320), colour=(132, 132, 132))) is None, "hardly brighter than the road"
    assert marking_gsd_mm(drawn((0, 80, 3, 320))) is None, "cut off along its length"
    assert marking_gsd_mm(drawn((200, 80, 212, 320), colour=ORANGE)) is None, "paint of utilities"


@pytest.mark.parametrize("worn", [False, True])
def test_bars_of_a_crossing_are_no_lines(worn: bool) -> None:
    bars = [(60 + 40 * at, 100, 75 + 40 * at, 260) for at in range(7)]
    picture = drawn(*bars)
    if worn:
        for left, top, right, _ in bars[::2]:
            picture[top + 30 : top + 90, left + 5 : right] = picture[top + 30 : top + 90, left - 20 : right - 25]
    assert len(painted_lines(drawn(*bars[:1]))) == 1
    assert painted_lines(picture) == []


def test_bars_that_the_border_cuts_off_are_no_lines() -> None:
    assert painted_lines(drawn((60, -9, 105, 250), (165, -9, 210, 250))) == []


def test_yellow_lines_side_by_side_are_lines() -> None:
    assert len(painted_lines(drawn((180, -9, 200, 409), (220, -9, 240, 409), colour=YELLOW))) == 2


@pytest.mark.parametrize("beyond", [(60, 110, 40), (165, 165, 165)])
def test_a_kerb_is_no_lane_line(beyond: tuple[int, int, int]) -> None:
    picture = drawn((200, 0, 215, 400))
    assert marking_gsd_mm(picture) is not None
    picture[:, 216:] = beyond
    assert marking_gsd_mm(picture) is None


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_lines_of_frames_have_their_width() -> None:
    """Over painted lines of a town, of widths and ground resolutions that are known."""
    world = built("seattle_roosevelt").world
    renderer, camera = Renderer(Scene(world, seed=3, style="uniform")), find_camera("phantom4pro")
    bars = plan_ground(world, 3, style=street_style("uniform")).paint.bars
    long = bars[(2 * bars[:, 3] > 2.0) & (2 * bars[:, 4] < 0.2)]
    ratios = []
    for number, (x, y, yaw, _, half_m) in enumerate(long[:: len(long) // 24]):
        gsd_mm = 4.0 + number % 8
        view = look((x, y, 20.0), yaw_rad=yaw + 0.3, pitch_rad=-pi / 2, size_px=(384, 384),
                    vertical_fov_rad=2 * np.arctan(384 * gsd_mm / 1000 / 2 / 20.0))  # fmt: skip
        shown = renderer.frame(view, light=Light(45.0, 190.0, cloud_cover=1.0), camera=camera, seed=1, labels=False)
        found = marking_gsd_mm(shown.rgb, line_m=2 * half_m)
        ratios += [] if found is None else [found / gsd_mm]
    assert len(ratios) >= 8
    assert np.median(ratios) == pytest.approx(1.0, abs=0.05)
    assert np.mean(np.abs(np.array(ratios) - 1) < 0.1) >= 0.6
