"""Shadows: the fit of the shadow map, objects that only cast one, and thin objects."""

import math
from dataclasses import replace
from functools import cache
from math import pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.arrays import Float64Array
from pavetwin.capture.platforms.car import FRONT, REAR
from pavetwin.render.projection import SHADOW_PX, SHADOW_REACH_M, SHADOW_TEXEL_PX, ShadowFit, fit_shadow, seen_points
from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import SUN_RADIUS_RAD, Light, harmonics
from pavetwin.scene.models import library
from pavetwin.scene.shafts import WIRE, shafts
from pavetwin.scene.values import Instance
from pavetwin.scene.view import View, look, nadir
from pavetwin.scene.wires import between
from pavetwin.traffic.kinds import VEHICLES, Kind
from pavetwin.uav.cameras import find_camera
from scenes.stage import Box, Plane, light_of, plane_renderer

SIDE_PX = 640
lights = st.builds(Light, st.floats(8.0, 88.0), st.floats(0.0, 359.0))
yaws = st.floats(-math.pi, math.pi)


def from_above(height_m: float, yaw_rad: float) -> View:
    return nadir(find_camera("phantom4pro"), (12.3, -45.6, height_m), yaw_rad=yaw_rad, size_px=(SIDE_PX, SIDE_PX))


def texels(fit: ShadowFit, points: Float64Array) -> Float64Array:
    """Columns and rows at which points, relative to the camera, lie."""
    placed = np.column_stack([points, np.ones(len(points))]) @ fit.matrix.T
    assert placed[:, 2].min() > 0
    assert placed[:, 2].max() < 1
    return np.asarray(placed[:, :2] * fit.size_px)


@given(lights, yaws, st.floats(3.0, 40.0))
def test_all_that_is_seen_lies_in_the_rectangle(light: Light, yaw_rad: float, height_m: float) -> None:
    for view in (
        from_above(height_m, yaw_rad),
        look(
            (0.0, 0.0, 1.3),
            yaw_rad=yaw_rad,
            pitch_rad=-0.2,
            size_px=(SIDE_PX, SIDE_PX),
            vertical_fov_rad=math.radians(50),
        ),
    ):
        fit = fit_shadow(view, light)
        at = texels(fit, seen_points(view, SHADOW_REACH_M) - view.position)
        assert at.min() > 0
        assert (at < fit.used_px).all()
        assert max(fit.used_px) <= fit.size_px <= SHADOW_PX[1]


@given(lights, yaws, st.floats(5.0, 20.0))
def test_texels_are_as_fine_as_asked_and_few_are_empty(light: Light, yaw_rad: float, height_m: float) -> None:
    view = from_above(height_m, yaw_rad)
    fit = fit_shadow(view, light)
    assert fit.texel_m <= SHADOW_TEXEL_PX * height_m / view.focal_px * 1.001
    ground_m2 = (SIDE_PX * height_m / view.focal_px) ** 2 * math.sin(math.radians(light.sun_elevation_deg))
    # With what stands on it up to four metres.
    assert np.prod(2 * fit.half_m) < 1.6 * ground_m2 + 4.0 * 2.1 * SIDE_PX * height_m / view.focal_px + 6.0


@given(lights, yaws, st.floats(5.0, 20.0), st.floats(0.05, 3.0))
def test_texels_stay_where_they_are_when_the_camera_moves(
    light: Light, yaw_rad: float, height_m: float, way_m: float
) -> None:
    view = from_above(height_m, yaw_rad)
    there = View(view.position + np.array([way_m, 0.4 * way_m, 0.0]), view.rotation, view.size_px, view.focal_px)
    first, second = fit_shadow(view, light), fit_shadow(there, light)
    assert first.used_px == second.used_px
    assert first.texel_m == second.texel_m
    point = np.array([[15.0, -44.0, 0.0]])
    step = texels(first, point - view.position) - texels(second, point - there.position)
    assert np.abs(step - np.round(step)).max() < 1e-3


VIEW = look((0, 0, 12), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(320, 240), vertical_fov_rad=1.0)
CAR = Box(1.0, 0.0, 3.8, 1.7, 1.5, label=4)
SUN_IN_WEST, LOW = 270.0, 45.0


def sample(**instances: object):
    return plane_renderer().frame(VIEW, light=Light(LOW, SUN_IN_WEST), camera=find_camera("paper"), **instances)


def test_it_is_not_in_the_image_but_its_shadow_is() -> None:
    empty, shadow_only = sample(), sample(shadow_only=[CAR.instance])
    assert (shadow_only.labels == 0).all()
    assert shadow_only.amodal_px == {}
    np.testing.assert_array_equal(shadow_only.depth_m, empty.depth_m)
    # With the sun in the west, 45° high, the shadow's end lies as far east of the roof's edge as the roof is high.
    inside, beyond = VIEW.project([[1.0 + 1.9 + 1.0, 0, 0], [1.0 + 1.9 + 2.2, 0, 0]]).astype(int)
    share = shadow_only.rgb[inside[1], inside[0]].mean() / shadow_only.rgb[beyond[1], beyond[0]].mean()
    assert share < 0.75


def test_it_stands_next_to_what_is_seen() -> None:
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


WEST, HIGH_DEG, UP_M = 270.0, 50.0, 6.0
SUNNY = Light(HIGH_DEG, WEST)
ASIDE_M = UP_M / tan(radians(HIGH_DEG))
"""How far east of a wire its shadow lies."""

SHADOWS = {-0.7: 0.006, 0.5: 0.015, 1.7: 0.05}
"""Where shadows of level wires lie east of the origin, and the radius of each."""

WIRES = np.array([[x - ASIDE_M, -9.0, UP_M, x - ASIDE_M, 9.0, UP_M, radius] for x, radius in SHADOWS.items()])


@cache
def wired() -> Renderer:
    return Renderer(Plane(thin=WIRES, models=dict(shafts())))


def dimmed(pixel_m: float = 0.01, light: Light = SUNNY, boxes: tuple[Box, ...] = ()) -> np.ndarray:
    """Share of the radiance without wires along a line of 4 m from west to east, 0.5 east of the origin its middle."""
    width = round(4.0 / pixel_m)
    view = look(
        (0.5, 0.5, 4.0),
        yaw_rad=pi / 2,
        pitch_rad=-pi / 2,
        size_px=(width, 64),
        vertical_fov_rad=2 * np.arctan(32 * pixel_m / 4.0),
    )
    shown = [box.instance for box in boxes]
    row, bare = (
        light_of(renderer, view, light=light, instances=shown, truth=False).radiance[32, :, 1].astype(float)
        for renderer in (wired(), plane_renderer())
    )
    return np.asarray(row / bare)


def around(row: np.ndarray, x: float) -> np.ndarray:
    """The part of a line within half a metre of a place."""
    metres = -1.5 + (np.arange(len(row)) + 0.5) * 4.0 / len(row)
    return np.asarray(row[np.abs(metres - x) < 0.5])


def hidden_share(radius_m: float) -> float:
    """Of the sun's disc, behind a wire across its middle, counted in points of it."""
    reach = tan(SUN_RADIUS_RAD) * UP_M / sin(radians(HIGH_DEG))
    x, y = np.meshgrid(*[np.linspace(-reach, reach, 801)] * 2)
    disc = np.hypot(x, y) < reach
    return float((disc & (np.abs(x) < radius_m)).sum() / disc.sum())


@pytest.mark.parametrize("x", SHADOWS)
def test_a_wire_dims_the_sun_by_the_share_of_its_disc(x: float) -> None:
    sun, sky = SUNNY.sun_klux[1] * SUNNY.to_sun[2], harmonics([0.0, 0.0, 1.0]) @ SUNNY.sky_irradiance[:, 1]
    depth = 1 - around(dimmed(), x).min()
    assert depth == pytest.approx(sun / (sun + sky) * hidden_share(SHADOWS[x]), rel=0.08)


def test_it_lies_where_the_sun_casts_it_and_is_as_wide_as_the_sun_blurs_it() -> None:
    row = around(dimmed(), 0.5)
    assert abs(int(row.argmin()) - 50) < 3
    blurred_m = 2 * tan(SUN_RADIUS_RAD) * UP_M / sin(radians(HIGH_DEG)) ** 2
    assert 0.01 * (row < 0.995).sum() == pytest.approx(blurred_m + 0.03 / sin(radians(HIGH_DEG)), abs=0.05)


def test_it_dims_as_much_in_all_with_coarse_pixels() -> None:
    fine, coarse = (pixel_m * (1 - dimmed(pixel_m)).sum() for pixel_m in (0.01, 0.04))
    assert coarse == pytest.approx(fine, rel=0.1)


def test_there_is_none_in_the_shade_or_under_clouds() -> None:
    assert dimmed(boxes=(Box(-2.0, 0.0, 0.5, 30.0, 12.0),)).min() > 0.99
    assert dimmed(light=Light(HIGH_DEG, WEST, cloud_cover=1.0)).min() == 1.0


def test_a_wire_is_seen_but_is_not_in_the_shadow_map() -> None:
    """There it would add dots to the strip that it shades."""
    row = WIRES[2]
    wire = Instance(WIRE, "body", between(row), np.tile(np.float32([1, 1, 1, 0]), (4, 1)))
    view = look((-2.0, 0.5, 12.0), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(640, 64), vertical_fov_rad=0.16)
    with_tube, without = (
        light_of(wired(), view, light=SUNNY, instances=each, truth=False).radiance[..., 1].astype(float)
        for each in ([wire], [])
    )
    changed = np.flatnonzero(np.abs(with_tube / without - 1).max(axis=0) > 0.02)
    middle, _ = view.project([[row[0], 0.5, UP_M]])[0]
    assert 3 < len(changed) < 12
    assert np.abs(changed - middle).max() < 8
