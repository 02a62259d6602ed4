"""What throws its shadow into a picture without being in it: the vehicle that carries the camera."""

from dataclasses import replace
from math import pi

import numpy as np

from pavetwin.scene.light import Light
from pavetwin.scene.view import look
from pavetwin.uav.cameras import cameras
from scenes.stage import Box, plane_renderer

VIEW = look((0, 0, 12), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(320, 240), vertical_fov_rad=1.0)
CAR = Box(1.0, 0.0, 3.8, 1.7, 1.5, label=4)
WEST, LOW = 270.0, 45.0


def shot(**instances: object):
    return plane_renderer().frame(VIEW, light=Light(LOW, WEST), camera=cameras()["paper"], **instances)  # type: ignore[arg-type]


def test_it_is_not_in_the_picture_but_its_shadow_is() -> None:
    empty, unseen = shot(), shot(unseen=[CAR.instance])
    assert (unseen.labels == 0).all()
    assert unseen.alone_px == {}
    np.testing.assert_array_equal(unseen.depth_m, empty.depth_m)
    # With the sun in the west, 45° high, the shadow's end lies as far east of the roof's edge as the roof is high.
    inside, beyond = VIEW.project([[1.0 + 1.9 + 1.0, 0, 0], [1.0 + 1.9 + 2.2, 0, 0]]).astype(int)
    share = unseen.rgb[inside[1], inside[0]].mean() / unseen.rgb[beyond[1], beyond[0]].mean()
    assert share < 0.75


def test_it_stands_beside_what_is_seen() -> None:
    other = replace(CAR, y=-3.0, label=9)
    frame = shot(instances=[other.instance], unseen=[CAR.instance])
    assert set(np.unique(frame.labels)) == {0, 9}
    assert set(frame.alone_px) == {9}
    assert frame.alone_px[9] == int((frame.labels == 9).sum())
