"""Leaves are cut out of cards alike in images, labels and shadows."""

from functools import cache
from math import atan, pi

import numpy as np
import pytest

from pavetwin.render.frame import RenderedFrame
from pavetwin.render.renderer import Renderer
from pavetwin.scene.foliage import CUT, cells, leaf_atlas
from pavetwin.scene.light import Light
from pavetwin.scene.values import TINTS, Instance, Mesh, Model
from pavetwin.scene.view import look
from pavetwin.uav.cameras import find_camera
from scenes.stage import Box, Plane, light_of

HIGH_SUN = Light(89.0, 180.0)
UP_M = 3.0
SIDE_M = 4.0


def card(gap: bool) -> Model:
    """The first cell of the sheet, 4 m wide, level; or the same without leaves, solid."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    positions = np.column_stack([SIDE_M * (square - 0.5), np.zeros(4)]).astype(np.float32)
    up = np.tile(np.array([0, 0, 1], dtype=np.float32), (4, 1))
    colours = np.full((4, 3), 0.2, dtype=np.float32)
    surface = np.tile(np.array([200, 0, 0], dtype=np.uint8), (4, 1))
    triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    mesh = Mesh(positions, up, triangles, colours, surface, square / 2 if gap else None)
    return Model("leafy" if gap else "solid", {"body": mesh})


@cache
def renderer() -> Renderer:
    return Renderer(Plane(models={"leafy": card(True), "solid": card(False)}))


def placed(model: str, z_m: float) -> Instance:
    transform = np.eye(4)
    transform[2, 3] = z_m
    return Instance(model, "body", transform, np.tile(np.float32([1, 1, 1, 0]), (TINTS, 1)))


def shown(model: str, height_m: float = 12.0) -> RenderedFrame:
    """A card over a labelled slab, from above."""
    slab = Box(0, 0, 8, 8, 0.1, label=7)
    view = look((0, 0, height_m), yaw_rad=0.0, pitch_rad=-pi / 2, size_px=(320, 320), vertical_fov_rad=0.6)
    instances = (placed(model, UP_M), slab.instance)
    return renderer().frame(view, light=HIGH_SUN, camera=find_camera("paper"), instances=instances)


def share_of_leaves() -> float:
    return float((cells(leaf_atlas())[0][..., 3] >= 255 * CUT).mean())


@pytest.mark.parametrize("height_m", [12.0, 30.0, 90.0])
def test_what_lies_behind_a_gap_is_labelled_and_behind_a_leaf_it_is_not(height_m: float) -> None:
    seen = shown("leafy", height_m)
    assert seen.labels is not None
    assert seen.depth_m is not None
    pixels = 320 / (2 * np.tan(0.3) * (height_m - UP_M)) * SIDE_M
    hidden = seen.depth_m < height_m - UP_M + 0.5
    assert hidden.sum() / pixels**2 == pytest.approx(share_of_leaves(), rel=0.1)
    assert (seen.labels[hidden] == 0).all()
    behind = (seen.labels == 7) & (seen.depth_m > height_m - 0.5)
    assert (behind | hidden)[150:170, 150:170].all()
    assert behind.any()


def test_a_solid_card_hides_all() -> None:
    seen = shown("solid")
    assert seen.depth_m is not None
    pixels = 320 / (2 * np.tan(0.3) * (12.0 - UP_M)) * SIDE_M
    assert (seen.depth_m < 9.5).sum() / pixels**2 == pytest.approx(1.0, abs=0.02)


def test_the_image_shows_leaves_where_labels_have_them() -> None:
    seen = shown("leafy")
    assert seen.depth_m is not None
    leaf = seen.depth_m < 9.5
    steps = [(axis, step) for axis in (0, 1) for step in (-2, 2)]
    core, away = (np.all([np.roll(where, step, axis=axis) for axis, step in steps], axis=0) for where in (leaf, ~leaf))
    sunlit = np.zeros_like(leaf)
    sunlit[:20] = True  # beyond the card and its shadow
    leaves, slab = (seen.rgb[where].astype(float).mean(axis=-1) for where in (core & leaf, away & ~leaf & sunlit))
    assert len(leaves) > 500
    # Of half the slab's reflectance, and darkened by the sheet.
    assert np.quantile(leaves, 0.98) < np.quantile(slab, 0.02)


def test_the_sun_shines_through_gaps() -> None:
    leafy, solid, bare = (lit_share(model) for model in ("leafy", "solid", None))
    assert bare > 0.98
    assert solid < 0.05
    assert leafy == pytest.approx(1 - share_of_leaves(), abs=0.06)


def lit_share(model: str | None) -> float:
    """The share of the ground below a card that the sun reaches, seen by a camera just below the card."""
    view = look((0, 0, 5), yaw_rad=0.0, pitch_rad=-pi / 2, size_px=(256, 256), vertical_fov_rad=2 * atan(SIDE_M / 10))
    instances = () if model is None else (placed(model, 5.3),)
    seen, bare = (light_of(renderer(), view, light=HIGH_SUN, instances=some, truth=False) for some in (instances, ()))
    return float((seen.radiance[..., 1].astype(float) > 0.6 * bare.radiance[..., 1]).mean())
