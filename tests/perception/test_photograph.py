"""Where the pixels of a photograph lie on the ground, worked out by hand from what it says of itself."""

from io import BytesIO
from math import cos, radians, tan

import numpy as np
import pytest
from PIL import Image

from pavetwin.perception.photograph import PhotographPose, pose_of
from scenes.aerial import FOCAL_PX, HEIGHT_M, LATITUDE, LONGITUDE, aerial_photograph

SIZE = (640, 480)
GSD_M = HEIGHT_M / FOCAL_PX
NORTH_M = 111_265.0
"""A degree of latitude at 52.5°, in metres."""


def pose(**tags: float) -> PhotographPose:
    with Image.open(BytesIO(aerial_photograph(Image.new("RGB", SIZE), **tags))) as held:
        return pose_of(held)


def offset_m(pose: PhotographPose, x: float, y: float) -> tuple[float, float]:
    """East and north of the camera."""
    places = pose.lonlats(np.array([[x, y]]))
    assert places is not None
    ((longitude, latitude),) = places
    east = (longitude - LONGITUDE) * NORTH_M * cos(radians(LATITUDE)) * 1.002
    return east, (latitude - LATITUDE) * NORTH_M


@pytest.mark.parametrize(
    ("heading_deg", "right_of_the_middle"), [(0.0, (1, 0)), (90.0, (0, -1)), (180.0, (-1, 0)), (-90.0, (0, 1))]
)
def test_looking_down_the_pictures_right_is_right_of_the_heading(
    heading_deg: float, right_of_the_middle: tuple[int, int]
) -> None:
    said = pose(GimbalYawDegree=heading_deg)
    assert said.lonlat == pytest.approx((LONGITUDE, LATITUDE), abs=1e-7)
    assert said.gsd_mm(10, 400) == pytest.approx(1000 * GSD_M)
    assert offset_m(said, 320, 240) == pytest.approx((0, 0), abs=0.01)
    away = 320 * GSD_M
    assert offset_m(said, 640, 240) == pytest.approx([away * each for each in right_of_the_middle], abs=0.01)


def test_looking_ahead_the_middle_lies_ahead_and_no_size_is_given() -> None:
    """At 40° below the horizon the middle is height / tan 40° away; what is at or above the horizon is nowhere."""
    said = pose(GimbalYawDegree=90.0, GimbalPitchDegree=-40.0)
    assert offset_m(said, 320, 240) == pytest.approx((HEIGHT_M / tan(radians(40)), 0), abs=0.02)
    assert said.gsd_mm(320, 240) is None
    assert pose(GimbalPitchDegree=-2.0).lonlats(np.array([[320.0, 0.0]])) is None


def test_a_little_tilt_makes_far_pixels_larger() -> None:
    said = pose(GimbalPitchDegree=-75.0)
    far, near = said.gsd_mm(320, 0), said.gsd_mm(320, 480)
    assert far is not None
    assert near is not None
    assert far > 1.1 * near


def test_what_a_photograph_does_not_say_is_not_known() -> None:
    plain = BytesIO()
    Image.new("RGB", SIZE).save(plain, "JPEG")
    with Image.open(plain) as held:
        assert pose_of(held) == PhotographPose(SIZE)
    turned = pose(orientation=6)
    assert turned.size_px == (480, 640)
    assert turned.lonlat is not None
    assert turned.gsd_mm(5, 5) is None
    assert pose(RelativeAltitude=-3.0).gsd_mm(5, 5) is None
