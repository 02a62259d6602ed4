"""Shadows of wires and twigs: as dark and soft as the sun's disc behind them makes them, at any size of a pixel."""

from functools import cache
from math import pi, radians, sin, tan

import numpy as np
import pytest

from pavetwin.render.renderer import Renderer
from pavetwin.scene.light import SUN_RADIUS_RAD, Light, harmonics
from pavetwin.scene.shafts import WIRE, shafts
from pavetwin.scene.values import Instance
from pavetwin.scene.view import look
from pavetwin.scene.wires import between
from scenes.stage import Box, Plane, light_of, plane_renderer

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
