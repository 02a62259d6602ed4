"""Road in pictures: where it is, its direction, free places, and ground resolution by painted lines."""

from math import pi

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageFilter

from pavetwin.arrays import BoolArray, UInt8Array
from pavetwin.labels.common_form import Annotation
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground import plan_ground
from pavetwin.scene.ground.styles import street_style
from pavetwin.scene.light import Light
from pavetwin.scene.scene import Scene
from pavetwin.scene.view import look
from pavetwin.training.datasets.blending import EDGE_PX, GONE_SHARE, KEPT_SHARE, Sun, blended, covered, pasted, turned
from pavetwin.training.datasets.cutouts import CutOut
from pavetwin.training.datasets.road import (
    FreeRoad,
    Standing,
    marking_gsd_mm,
    painted_lines,
    road_direction_deg,
    road_mask,
)
from pavetwin.uav.cameras import find_camera
from scenes import built
from scenes.photographs import pavement

SIZE = (200, 160)
SOLID = np.ones((20, 40), dtype=np.float32)


def cut_out(grey: int = 90, around: float = 120.0) -> CutOut:
    pixels = np.full((24, 54, 4), grey, dtype=np.uint8)
    pixels[..., 3] = 0
    pixels[2:22, 2:52, 3] = 255
    return CutOut("c-000", "Car", pixels, 50.0, 20.0, 0.0, (around, around, around), 90.0)


def test_road_is_what_is_grey_and_smooth() -> None:
    picture = pavement(SIZE)
    picture[:, :50] = (60, 110, 40)
    picture[:, 180:] = 0
    picture[70:74, 100:] = 230
    road = road_mask(picture)
    assert road[:, :46].mean() < 0.02
    assert road[:, 184:].mean() < 0.05
    assert road[10:-10, 60:170].mean() > 0.97


def verge(share: float, colour: tuple[int, int, int] = (150, 128, 90)) -> tuple[np.ndarray, np.ndarray]:
    """Pavement with dry grass, smooth, over a share of its left; and damage labelled on the rest."""
    picture, damage = pavement(SIZE), np.zeros(SIZE[::-1], dtype=np.bool_)
    picture[:, : int(share * SIZE[0])] = colour
    damage[70:90, 160:190] = True
    return picture, damage


def test_damage_tells_which_colour_road_has() -> None:
    picture, damage = verge(0.7)
    assert not road_mask(picture).any(), "most of it is not pavement"
    road = road_mask(picture, damage)
    assert road[:, :136].mean() < 0.01
    assert road[:, 148:-4].mean() > 0.97


def test_a_part_without_the_labelled_damage_is_no_road() -> None:
    picture, damage = verge(0.3)
    picture[:, :20] = pavement((20, SIZE[1]))
    picture[:, 20:60] = (60, 110, 40)
    picture[:, 60:120] = pavement((60, SIZE[1]))
    picture[:, 120:140] = (60, 110, 40)
    assert road_mask(picture)[:, 70:110].mean() > 0.97
    road = road_mask(picture, damage)
    assert road[:, :130].mean() < 0.01
    assert road[:, 148:-4].mean() > 0.97


def sidewalk(paving: str) -> tuple[UInt8Array, BoolArray]:
    """A road with a lane line and labelled damage; beyond a kerb of stone, paving that is grey as well."""
    picture, damage = pavement(SIZE), np.zeros(SIZE[::-1], dtype=np.bool_)
    picture[:, 130:133] = 210
    picture[:, 64:72] = pavement((8, SIZE[1]), 1, 150)
    if paving == "lighter":
        picture[:, :64] = pavement((64, SIZE[1]), 2, 165)
    elif paving == "reddish":
        picture[:, :64] = (pavement((64, SIZE[1]), 2).astype(int) + (9, 0, -2)).astype(np.uint8)
    else:  # tiles
        picture[::6, :64] = picture[:, :64:6] = 95
    damage[70:90, 160:190] = True
    return picture, damage


@pytest.mark.parametrize("paving", ["lighter", "reddish", "tiles"])
def test_grey_paving_beyond_a_kerb_is_no_road(paving: str) -> None:
    picture, damage = sidewalk(paving)
    road = road_mask(picture, damage)
    assert road[:, :60].mean() < 0.02
    assert road[6:-6, 84:190].mean() > 0.97, "the lane line lies in the road"
    assert abs(road_direction_deg(picture, road) or 0.0) == pytest.approx(90, abs=3)


def test_an_object_keeps_away_from_the_edge_of_the_road() -> None:
    picture, damage = sidewalk("lighter")
    road = road_mask(picture, damage)
    edge = int(np.flatnonzero(road.all(axis=0))[0])
    places = [FreeRoad(road, np.zeros_like(road), 12).place(SOLID, np.random.default_rng(seed)) for seed in range(20)]
    assert min(each.left for each in places if each is not None) >= edge + 12


def test_markings_tell_the_direction_of_a_road() -> None:
    picture, road = pavement(SIZE), np.ones(SIZE[::-1], dtype=np.bool_)
    assert road_direction_deg(picture, road) is None
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    picture[np.abs((y - 80) - np.tan(np.radians(25)) * (x - 100)) < 4] = 235
    assert road_direction_deg(picture, road) == pytest.approx(25, abs=3)


@given(st.integers(0, 2**31), st.integers(0, 12))
@example(29334, 7)
def test_nothing_leaves_the_road_or_comes_near_what_stands_there(seed: int, gap: int) -> None:
    rng = np.random.default_rng(seed)
    road, taken = np.zeros(SIZE[::-1], dtype=np.bool_), np.zeros(SIZE[::-1], dtype=np.bool_)
    road[:, 40:180] = True
    taken[60:80, 90:120] = True
    ground, places = FreeRoad(road, taken, gap), []
    while len(places) < 3 and (standing := ground.place(SOLID, rng)) is not None:
        assert road[standing.window].all()
        ground.take(standing)
        places.append((standing.left, standing.top, standing.left + 40, standing.top + 20))
    boxes = [*places, (90, 60, 120, 80)]
    for at, one in enumerate(boxes):
        for other in boxes[:at]:
            apart = (max(one[0], other[0]) - min(one[2], other[2]), max(one[1], other[1]) - min(one[3], other[3]))
            between_middles = np.hypot(*np.maximum(np.array(apart) + 1, 0))  # of the pixels that are nearest
            assert between_middles > max(gap, 2)
    assert FreeRoad(road, road, gap).place(SOLID, rng) is None
    assert ground.place(np.ones((400, 40), dtype=np.float32), rng) is None


def test_an_object_has_its_size_and_soft_edges_at_another_scale() -> None:
    for scale, angle in ((0.6, 0.0), (1.4, 0.0), (1.0, 90.0)):
        shown = turned(cut_out(), scale, angle)
        rows, columns = np.nonzero(shown.opacity > 0.5)
        sides = (np.ptp(columns) + 1, np.ptp(rows) + 1)[:: -1 if angle else 1]
        # Its outermost pixels are cut off.
        assert sides == pytest.approx((50 * scale, 20 * scale), abs=5 * scale)
        assert ((shown.opacity > 0.1) & (shown.opacity < 0.9)).sum() > EDGE_PX * 40 * scale
        assert shown.opacity[[0, -1]].max() < 0.1


def standing_in(picture_size: tuple[int, int], opacity_shape: tuple[int, ...]) -> tuple[int, int]:
    return (picture_size[0] - opacity_shape[1]) // 2, (picture_size[1] - opacity_shape[0]) // 2


@pytest.mark.parametrize(("road", "expected"), [(120.0, 90), (80.0, 60), (170.0, 127), (30.0, 54)])
def test_brightness_follows_that_of_the_place_within_limits(road: float, expected: float) -> None:
    picture, shown = pavement(SIZE, brightness=road), turned(cut_out(), 1.0, 0.0)
    standing = Standing(*standing_in(SIZE, shown.opacity.shape), shown.opacity)
    result = blended(picture, shown, standing, cut_out(), gsd_mm=90, sun=None)
    assert result[75:85, 90:110].mean() == pytest.approx(expected, abs=3)
    assert (result[:20] == picture[:20]).all()


@pytest.mark.parametrize(("shadow_deg", "side"), [(90.0, "right"), (180.0, "down"), (270.0, "left")])
def test_a_shadow_falls_where_it_does(shadow_deg: float, side: str) -> None:
    picture, shown = pavement(SIZE), turned(cut_out(), 1.0, 0.0)
    standing = Standing(*standing_in(SIZE, shown.opacity.shape), shown.opacity)
    sun = Sun(shadow_deg, 45.0)
    result = blended(picture, shown, standing, cut_out(), gsd_mm=90, sun=sun).astype(float) / picture
    # 1.4 m under 45° reach 16 pixels of 90 mm.
    near = {"right": result[75:85, 128:138], "down": result[94:104, 90:110], "left": result[75:85, 62:72]}
    assert near.pop(side).mean() < 0.7
    assert min(part.mean() for part in near.values()) > 0.9
    assert blended(picture, shown, standing, cut_out(), gsd_mm=90, sun=Sun(90.0, 45.0, 1.0))[80, 135].mean() > 100


@given(st.integers(0, 60))
def test_a_label_stays_is_ignored_or_goes_by_its_visible_share(columns: int) -> None:
    over = np.zeros(SIZE[::-1], dtype=np.bool_)
    over[:, 50 : 50 + columns] = True
    for outline in (None, ((50.0, 20.0), (110.0, 20.0), (110.0, 40.0), (50.0, 40.0))):
        annotation = Annotation("Pothole", (50, 20, 110, 40), outline=outline)
        left, share = covered(annotation, over, SIZE), 1 - columns / 60
        if share < GONE_SHARE:
            assert left is None
            continue
        assert left is not None
        assert (left.ignored is None) == (share >= KEPT_SHARE)
        assert left.box == (50 + columns, 20, 110, 40)
        assert (left.outline is None) == (outline is None)
        ignored = Annotation(None, (50, 20, 110, 40), "class 'Block crack'")
        assert covered(ignored, over, SIZE) is not None


def test_the_label_of_an_object_is_that_of_its_pixels() -> None:
    mask = np.zeros(SIZE[::-1], dtype=np.bool_)
    mask[20:40, 50:110] = True
    label = pasted(mask, "Car", "c-000")
    assert (label.category, label.box, label.attributes) == ("Car", (50, 20, 110, 40), {"cut_out": "c-000"})
    assert label.outline is not None
    assert {(50.0, 20.0), (110.0, 40.0)} <= set(label.outline)


LINES_SIZE = (400, 400)
GAMMA, LENS_PX = 2.2, 0.8
"""Cameras blur light and store its root."""
WHITE, YELLOW, ORANGE = (210, 210, 210), (214, 160, 40), (235, 110, 30)


def drawn(
    *rectangles: tuple[float, float, float, float], angle_deg: float = 0.0, colour: tuple[int, int, int] = WHITE
) -> UInt8Array:
    """Pavement with strips (left, top, right, bottom), turned about its middle, as a camera sees them."""
    mask = Image.new("L", (4 * LINES_SIZE[0], 4 * LINES_SIZE[1]))
    for left, top, right, bottom in rectangles:
        ImageDraw.Draw(mask).rectangle([4 * left, 4 * top, 4 * right - 1, 4 * bottom - 1], fill=255)
    seen = mask.rotate(angle_deg, Image.Resampling.BICUBIC).filter(ImageFilter.GaussianBlur(4 * LENS_PX))
    share = np.asarray(seen.resize(LINES_SIZE, Image.Resampling.BOX)) / 255
    road, paint = ((np.asarray(each) / 255) ** GAMMA for each in (pavement(LINES_SIZE), colour))
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
    assert marking_gsd_mm(pavement(LINES_SIZE)) is None
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
