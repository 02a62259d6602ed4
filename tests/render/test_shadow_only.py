"""What throws its shadow into a picture without being in it: the vehicle that carries the camera."""

from dataclasses import replace
from math import pi, tan

import numpy as np
import pytest

from pavetwin.capture.platforms.car import FRONT, REAR
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import Light
from pavetwin.scene.models import library
from pavetwin.scene.view import look
from pavetwin.traffic.kinds import VEHICLES, Kind
from pavetwin.uav.cameras import find_camera
from scenes.stage import Box, Plane, light_of, plane_renderer

VIEW = look((0, 0, 12), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(320, 240), vertical_fov_rad=1.0)
CAR = Box(1.0, 0.0, 3.8, 1.7, 1.5, label=4)
WEST, LOW = 270.0, 45.0


def sample(**instances: object):
    return plane_renderer().frame(VIEW, light=Light(LOW, WEST), camera=find_camera("paper"), **instances)


def test_it_is_not_in_the_image_but_its_shadow_is() -> None:
    empty, shadow_only = sample(), sample(shadow_only=[CAR.instance])
    assert (shadow_only.labels == 0).all()
    assert shadow_only.amodal_px == {}
    np.testing.assert_array_equal(shadow_only.depth_m, empty.depth_m)
    # With the sun in the west, 45° high, the shadow's end lies as far east of the roof's edge as the roof is high.
    inside, beyond = VIEW.project([[1.0 + 1.9 + 1.0, 0, 0], [1.0 + 1.9 + 2.2, 0, 0]]).astype(int)
    share = shadow_only.rgb[inside[1], inside[0]].mean() / shadow_only.rgb[beyond[1], beyond[0]].mean()
    assert share < 0.75


def test_it_stands_beside_what_is_seen() -> None:
    other = replace(CAR, y=-3.0, label=9)
    frame = sample(instances=[other.instance], shadow_only=[CAR.instance])
    assert set(np.unique(frame.labels)) == {0, 9}
    assert set(frame.amodal_px) == {9}
    assert frame.amodal_px[9] == int((frame.labels == 9).sum())


@pytest.mark.parametrize("azimuth_deg", [55.6, 124.4])
def test_before_the_lens_the_own_shadow_has_an_even_edge(azimuth_deg: float) -> None:
    """A lens behind the windscreen sees 60 m far: what is too coarse to be seen there would be teeth and holes here."""
    renderer = Renderer(Plane(models={"hatchback": library()["hatchback"]}))
    car = replace(Box(0, 0, 1, 1, 1, label=4).instance, model="hatchback")
    view = look(
        (0.55, 0, FRONT.z_m),
        yaw_rad=0.0,
        pitch_rad=FRONT.pitch_rad,
        size_px=(480, 360),
        vertical_fov_rad=FRONT.camera.fov_rad,
    )
    bare, seen = (
        light_of(renderer, view, light=Light(55.0, azimuth_deg), shadow_only=each, truth=False)
        .radiance[..., 1]
        .astype(float)
        for each in ([], [car])
    )
    dark = seen / bare < 0.6
    columns = np.flatnonzero(dark.sum(axis=0) > 8)
    edge = dark.argmax(axis=0)[columns]
    assert len(columns) > 200
    inner = columns[1:-1]  # at its very sides the shadow is as deep as it is counted from
    assert np.ptp(inner) == len(inner) - 1
    even = np.convolve(edge, np.full(25, 1 / 25), "valid")
    assert np.abs(edge[12:-12] - even).mean() < 0.75


@pytest.mark.parametrize("kind", VEHICLES, ids=lambda kind: kind.name)
def test_the_rear_camera_looks_at_the_road_behind_the_vehicle(kind: Kind) -> None:
    ahead_m = REAR.ahead_m(kind.length_m) + REAR.z_m * tan(REAR.camera.fov_rad / 2)
    assert -kind.length_m / 2 - 0.1 < ahead_m < -kind.length_m / 2 + 0.1
