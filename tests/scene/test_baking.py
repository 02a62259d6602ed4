"""Pictures of the ground for the glTF export, against the formula that they are made by."""

from functools import cache

import numpy as np
import pytest

from pavetwin.scene.export.baking import BakedTexture, bake_patch, bake_tile
from pavetwin.scene.ground.materials.compose import MapPyramids, surface
from pavetwin.scene.ground.materials.sampling import srgb_of_linear
from pavetwin.scene.patches import patch_of
from pavetwin.scene.values import TILE_M, GroundKind, GroundMaps
from scenes.strips import KEY, ORIGIN, STRIP_M, Strips, axes, finish, grain_xy, pothole, pyramids, weathered

TEXEL_M = 0.032


@cache
def baked() -> BakedTexture:
    return bake_tile(Strips().tile(KEY), pyramids(), TEXEL_M)


@pytest.mark.parametrize("kind", GroundKind, ids=lambda kind: kind.name)
def test_grain_is_baked_along_the_images_axes_whichever_way_it_lies(kind: GroundKind) -> None:
    picture = baked()
    side = len(picture.colour)
    x, y = np.meshgrid((np.arange(side) + 0.5) * TILE_M / side, TILE_M - (np.arange(side) + 0.5) * TILE_M / side)
    inside = (np.abs(y - (kind + 0.5) * STRIP_M) < STRIP_M / 2 - 0.1) & (x < 8.0)
    local = np.column_stack([x[inside], y[inside]])
    found = surface(kind, grain_xy(kind, local), local, ORIGIN, pyramids(), TILE_M / side, finish(kind))
    assert np.abs(picture.colour[inside] - 255 * srgb_of_linear(found.albedo)).max() < 1.5
    bent = (picture.normal[inside].astype(float)[:, :2] - 128) / 127
    assert np.abs(bent - found.normal[:, :2] @ axes(kind)).max() < 0.006


def test_no_paint_lies_on_the_floor_of_a_baked_pothole() -> None:
    patch = patch_of(pothole())
    painted, unpainted = weathered().drawn.copy(), weathered().drawn.copy()
    painted[...], unpainted[..., 0], unpainted[..., 3] = (255, 0, 0, 1), 1, 1
    seen, bare = (
        bake_patch(patch, ORIGIN, MapPyramids.of(GroundMaps(weathered().weathering, drawn)), 0.005).colour.astype(int)
        for drawn in (painted, unpainted)
    )
    floor = patch.lost[::-1] == 255
    assert floor.sum() > 500
    assert np.array_equal(seen[floor], bare[floor])
    assert (seen - bare)[patch.lost[::-1] == 0].mean() > 50
