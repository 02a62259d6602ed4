"""Façades under an overcast sky, and the levels of their textures."""

from functools import cache
from math import asin, hypot, pi, radians

import numpy as np
import pytest

from pavetwin.render.gpu import halved, mean_linear
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground.materials.sampling import linear_of_srgb, srgb_of_linear
from pavetwin.scene.light import Light
from pavetwin.scene.values import DefectPatch, GroundMaps, Mesh, Tile, defect_label
from pavetwin.scene.view import look
from scenes.stage import light_of
from scenes.strips import ORIGIN, Strips, rotation

SLOPE = 1.8
"""The steepest that pothole walls usually are."""
MIDDLE = np.array([ORIGIN[0] + 16.0, ORIGIN[1] + 16.0, -0.27])
OVERCAST = Light(40.0, 120.0, cloud_cover=1.0, visibility_m=1e6)


class Wall(Strips):
    """Nothing but an even slope on a tile, its foot towards `turn_rad` less a quarter turn."""

    def __init__(self, turn_rad: float) -> None:
        super().__init__()
        corners = np.array([[-0.5, -0.15], [0.5, -0.15], [0.5, 0.15], [-0.5, 0.15]])
        positions = np.column_stack([corners, (corners[:, 1] - 0.15) * SLOPE]).astype(np.float32)
        upright = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
        uv = (corners / (1.0, 0.3) + 0.5).astype(np.float32)
        mesh = Mesh(positions, upright, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32), uv=uv)
        relief = np.empty((60, 200, 4), dtype=np.uint8)
        relief[:] = (128, round(128 - 127 * SLOPE / hypot(SLOPE, 1)), 128, 255)
        place = np.eye(4)
        place[:2, :2], place[:2, 3] = rotation(turn_rad).T, MIDDLE[:2]
        mask = np.full((60, 200), 255, dtype=np.uint8)
        self._patches = (DefectPatch(defect_label(0), mesh, mesh, place, relief, mask, np.zeros_like(mask)),)
        self._holes = {0: (*(MIDDLE[:2] - 1.0).tolist(), *(MIDDLE[:2] + 1.0).tolist())}

    def tile(self, key: tuple[int, int]) -> Tile:
        return Tile(key, (), (), ())

    def maps(self, _: tuple[int, int]) -> GroundMaps:
        return _untouched()


@cache
def _untouched() -> GroundMaps:
    weathering, drawn = (np.zeros((64, 64, 4), dtype=np.uint8) for _ in range(2))
    weathering[..., 0] = 128
    return GroundMaps(weathering, drawn)


@pytest.mark.parametrize("turn_rad", [0.0, 0.5, pi / 2, 2.4])
def test_grain_is_as_fine_down_a_wall_as_along_it(turn_rad: float) -> None:
    """Seen square on: planar grain would be twice as long down the wall as along it."""
    back = 0.8 * np.array([*(rotation(turn_rad).T @ [0.0, -SLOPE]), 1.0]) / hypot(SLOPE, 1)
    view = look(
        MIDDLE + back,
        yaw_rad=turn_rad + pi / 2,
        pitch_rad=-asin(1 / hypot(SLOPE, 1)),
        size_px=(240, 240),
        vertical_fov_rad=radians(20.0),
    )
    seen = light_of(Renderer(Wall(turn_rad)), view, light=OVERCAST, truth=False).radiance[..., 1].astype(np.float64)
    along, down = (np.abs(np.diff(seen, axis=axis)).mean() for axis in (1, 0))
    assert seen.min() > 0
    assert 0.7 < along / down < 1.4


TEXELS = np.random.default_rng(0).integers(0, 256, (8, 6, 4), dtype=np.uint8)


def test_a_level_holds_the_mean_light_of_four_texels() -> None:
    linear = linear_of_srgb(TEXELS[..., :3] / 255)
    four = linear.reshape(4, 2, 3, 2, 3).mean(axis=(1, 3))
    for options, coded in (({"srgb": True}, srgb_of_linear(four)), ({"rooted": True}, np.sqrt(four))):
        levels = halved(TEXELS, **options)
        assert [level.shape[:2] for level in levels] == [(8, 6), (4, 3), (2, 1), (1, 1)]
        assert np.abs(levels[1][..., :3] - 255 * coded).max() <= 0.51
        alpha = TEXELS[..., 3].reshape(4, 2, 3, 2).mean(axis=(1, 3))
        assert np.abs(levels[1][..., 3] - alpha).max() <= 0.51


def test_the_first_level_is_the_texture_itself_or_its_roots() -> None:
    assert np.array_equal(halved(TEXELS, srgb=True)[0], TEXELS)
    roots = 255 * np.sqrt(linear_of_srgb(TEXELS[..., :3] / 255))
    assert np.abs(halved(TEXELS, rooted=True)[0][..., :3] - roots).max() <= 0.51


def test_the_mean_reflectance_is_that_of_all_texels() -> None:
    assert mean_linear(TEXELS) == pytest.approx(linear_of_srgb(TEXELS[..., :3] / 255).mean(axis=(0, 1)), rel=1e-5)
