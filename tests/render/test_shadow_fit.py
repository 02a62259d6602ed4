"""The rectangle of the shadow map: it holds all that is seen, and little else."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.arrays import Float64Array
from pavetwin.render.projection import SHADOW_PX, SHADOW_REACH_M, SHADOW_TEXEL_PX, ShadowFit, fit_shadow, seen_points
from pavetwin.scene.light import Light
from pavetwin.scene.view import View, look, nadir
from pavetwin.uav import find_camera

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
