"""The halved levels of textures, and their mean reflectance, follow from linear light."""

import numpy as np
import pytest

from pavetwin.render.gpu import halved, mean_linear
from pavetwin.scene.ground.materials.sampling import linear_of_srgb, srgb_of_linear

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
