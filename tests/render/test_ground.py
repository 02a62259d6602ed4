"""The ground's shader against its formula in numpy (`scene.ground.materials.compose`), pixel by pixel."""

from math import pi

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, maximum_filter, uniform_filter

from pavetwin.defects import heightfield_of
from pavetwin.render.renderer import Renderer
from pavetwin.scene.ground.materials.compose import surface
from pavetwin.scene.light import LUMINANCE, Light, harmonics
from pavetwin.scene.patches import patch_of
from pavetwin.scene.values import TILE_M, GroundKind, defect_label
from pavetwin.scene.view import View, look
from scenes.stage import SeenLight, light_of
from scenes.strips import ORIGIN, STRIP_M, Strips, axes, finish, grain_xy, pothole, pyramids, rotation

FAR_SIGHT_M = 1e6
"""So that there is no haze."""

LIGHTS = {
    "overcast": Light(40.0, 120.0, cloud_cover=1.0, visibility_m=FAR_SIGHT_M),
    "sun": Light(35.0, 120.0, visibility_m=FAR_SIGHT_M),
}


@pytest.fixture(scope="module")
def strips() -> Renderer:
    return Renderer(Strips())


@pytest.fixture(scope="module")
def hole() -> Renderer:
    return Renderer(Strips(pothole()))


def points(view: View, seen: SeenLight) -> np.ndarray:
    """(height, width, 3) what every pixel shows, world frame; NaN for the sky."""
    assert seen.depth_m is not None
    width, height = view.size_px
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    depth = np.where(np.isfinite(seen.depth_m), seen.depth_m, np.nan)
    return np.asarray(view.position + view.rays(pixels) * depth[..., None])


def footprint_m(view: View, at: np.ndarray) -> np.ndarray:
    """Of pixels on level ground: between their short and their long side."""
    relative = at - view.position
    slant = -relative[..., 2] / np.linalg.norm(relative, axis=-1)
    return np.asarray(relative @ view.rotation[:, 2] / view.focal_px / np.sqrt(slant))


def radiance(
    albedo: np.ndarray, slope: np.ndarray, roughness: np.ndarray, open_: np.ndarray, towards: np.ndarray, light: Light
) -> np.ndarray:
    """(n, 3) kcd/m² of rough ground, seen steeply: Lambert, and 4 % mirrored by GGX facets.

    Args:
        albedo: (n, 3) linear reflectance.
        slope: (n, 2) of the normal, x and y over z.
        roughness: (n,)
        open_: (n,) share of the sky that reaches it.
        towards: (n, 3) unit vectors to the camera.
        light: without haze.
    """
    normal = np.column_stack([slope, np.ones(len(slope))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sky = np.maximum(harmonics(normal) @ light.sky_irradiance, 0) * open_[:, None]
    n_l, n_v = np.maximum(normal @ light.to_sun, 0), np.maximum((normal * towards).sum(axis=1), 0.05)
    matt = albedo / pi * (light.sun_klux * n_l[:, None] + sky)
    # What a surface mirrors of even surroundings (Karis 2014, Physically Based Shading on Mobile).
    r = roughness[:, None] * (-1.0, -0.0275, -0.572, 0.022) + (1.0, 0.0425, 1.04, -0.04)
    a = np.minimum(r[:, 0] ** 2, 2 ** (-9.28 * n_v)) * r[:, 0] + r[:, 1]
    around = (0.04 * (r[:, 2] - 1.04 * a) + r[:, 3] + 1.04 * a)[:, None] * sky / pi
    # And of the sun: the facets' spread after Walter et al. 2007, their shadows after Hammon 2017, Schlick's Fresnel.
    half = light.to_sun + towards
    half /= np.linalg.norm(half, axis=1)[:, None]
    alpha, n_h = roughness**2, np.maximum((normal * half).sum(axis=1), 0)
    spread = alpha**2 / (pi * (n_h**2 * (alpha**2 - 1) + 1) ** 2)
    shown = 0.5 / (2 * n_l * n_v * (1 - alpha) + (n_l + n_v) * alpha)
    fresnel = 0.04 + 0.96 * (1 - (towards * half).sum(axis=1)) ** 5
    return np.asarray(matt + around + (fresnel * spread * shown * n_l)[:, None] * light.sun_klux)


def expected(
    kind: GroundKind, view: View, light: Light, at: np.ndarray, relief: np.ndarray | None = None
) -> np.ndarray:
    """(n, 3) kcd/m² of ground at points (n, 3), by the formula; `relief` (n, 5): the maps of a `DefectPatch`, its lost
    share last, 0 … 255."""
    local = at[:, :2] - ORIGIN
    lost = 0.0 if relief is None else relief[:, 4] / 255
    found = surface(kind, grain_xy(kind, local), local, ORIGIN, pyramids(), footprint_m(view, at), finish(kind), lost)
    slope = found.normal[:, :2].astype(np.float64) / found.normal[:, 2:] @ axes(kind)
    towards = (view.position - at) / np.linalg.norm(view.position - at, axis=1)[:, None]
    if relief is None:
        return radiance(found.albedo, slope, found.roughness, np.ones(len(at)), towards, light)
    bent = (relief[:, :2] - 128) / 127
    slope += bent / np.sqrt(np.maximum(1 - (bent**2).sum(axis=1), 0.02))[:, None] @ rotation(pothole().yaw_rad)
    albedo = np.clip(found.albedo * relief[:, 2:3] / 128, 0, 1)
    return radiance(albedo, slope, found.roughness, relief[:, 3] / 255, towards, light)


def assert_alike(seen: np.ndarray, wanted: np.ndarray) -> None:
    """Radiances (n, 4) and (n, 3), by the worst of a pixel's colours.

    Cards weigh neighbouring texels in 256ths and store halved levels in 8 bits. Where paint ends within a texel that
    is some percent.
    """
    off = np.abs(seen[:, :3] / wanted - 1).max(axis=1)
    half, most, nearly_all = np.quantile(off, [0.5, 0.9, 0.99])
    assert half < 0.01
    assert most < 0.02
    assert nearly_all < 0.08


@pytest.mark.parametrize("kind", GroundKind, ids=lambda kind: kind.name)
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_every_kind_of_ground_looks_as_its_formula_states(strips: Renderer, light: Light, kind: GroundKind) -> None:
    """From where single stones show, from where they melt, and from the side."""
    x, y = ORIGIN[0] + TILE_M / 2, ORIGIN[1] + (kind + 0.5) * STRIP_M
    for height_m, pitch, aside_m in ((1.0, -pi / 2, 4.0), (5.0, -pi / 2, 0.0), (18.0, -pi / 2, 0.0), (4.0, -1.1, 0.0)):
        view = look((x + aside_m, y, height_m), yaw_rad=0.4, pitch_rad=pitch, size_px=(160, 120), vertical_fov_rad=0.9)
        seen = light_of(strips, view, light=light)
        at = points(view, seen)
        border = 0.1 + footprint_m(view, at)
        local = at[..., :2] - ORIGIN
        inside = np.abs(local[..., 1] - (kind + 0.5) * STRIP_M) < STRIP_M / 2 - border
        inside &= np.abs(local[..., 0] - TILE_M / 2) < TILE_M / 2 - border
        assert inside.sum() > 2000
        assert_alike(seen.radiance[inside], expected(kind, view, light, at[inside]))


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
def test_a_defect_looks_as_its_heightfield_states(hole: Renderer, light: Light) -> None:
    """But for its walls: asphalt with the relief of its maps, from where a pixel is smaller than their cells."""
    defect = pothole()
    view = look(
        (defect.centre.x, defect.centre.y, 0.9),
        yaw_rad=0.4,
        pitch_rad=-pi / 2,
        size_px=(320, 240),
        vertical_fov_rad=1.0,
    )
    seen = light_of(hole, view, light=light)
    shown = seen.labels == defect_label(defect.id)
    at = points(view, seen)[shown]
    own = (at[:, :2] - (defect.centre.x, defect.centre.y)) @ rotation(defect.yaw_rad).T
    patch = patch_of(defect)
    relief = np.concatenate([patch.relief, patch.lost[..., None]], axis=-1).astype(np.float64)
    texel = heightfield_of(defect).uv(own)[:, ::-1] * relief.shape[:2] - 0.5
    there = np.stack([map_coordinates(layer, texel.T, order=1) for layer in np.moveaxis(relief, 2, 0)]).T
    steep = maximum_filter(np.abs(uniform_filter(relief[..., :2], (4, 4, 0)) - 128).max(axis=2), 9)
    gentle = map_coordinates(steep, texel.T, order=0) < 50
    assert gentle.sum() > 3000
    assert (there[gentle, 4] > 250).mean() > 0.3, "without its paint"
    wanted = expected(GroundKind.SLABS, view, light, at[gentle], there[gentle])
    assert_alike(seen.radiance[shown][gentle], wanted)
    # What is left when the defect's own share is taken out is the pavement that was there before.
    changed = seen.radiance[shown][gentle, 3].astype(np.float64)
    assert np.quantile(changed, 0.05) < 0.8
    before = expected(GroundKind.SLABS, view, light, at[gentle])
    level, wanted_level = (
        values[:, :3].astype(np.float64) @ LUMINANCE for values in (seen.radiance[shown][gentle], before)
    )
    assert_alike((level / changed)[:, None], wanted_level[:, None])
    assert (seen.radiance[~shown & (seen.labels == 0)][:, 3] > 0.9).all()
