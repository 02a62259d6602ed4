"""From a view and a light to the matrices and numbers of one frame."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array, StructuredArray
from pavetwin.scene.light import SUN_RADIUS_RAD, Light
from pavetwin.scene.view import View

NEAR_M: Final = 0.1
"""Near plane [m]."""

SHADOW_PX: Final = (512, 2048)  # Side of the shadow map at least and at most [texels]
SHADOW_STEP_PX: Final = 256  # Sides are multiples of this, so that few maps serve all views
SHADOW_TEXEL_PX: Final = 1.25
"""Texel of the shadow map that is fine enough, in pixels of the image where the ground is nearest: 2 cm from 10 m,
half of what the sun's disc blurs of a leaf 5 m up."""

_TEXELS_AN_OCTAVE: Final = 8
_TURN_DEG: Final = 7.5
_MARGIN_M: Final = 0.25
"""Margin around the view for a camera that moves during the exposure [m]."""

SHADOW_REACH_M: Final = 60.0  # Level views have shadows up to this distance [m]
_HARMONICS: Final = np.array([0.282095, *[0.488603] * 3, 1.092548, 1.092548, 0.315392, 1.092548, 0.546274])
"""Factors of the real spherical harmonics, next to their polynomials in the normal."""

_SHADOW_DEPTH_M: Final = 400.0
_RECEIVER_M: Final = 4.0
"""Shadows fall on the ground and on objects up to this height [m]."""

_HIGHER: Final = np.array([[index & 4, index & 2, index & 1] for index in range(8)]) > 0
"""Signs of the corners of a box."""

FRAME_INFO: Final = np.dtype(
    [
        ("to_clip", "f4", (4, 4)),
        ("to_shadow", "f4", (4, 4)),
        ("to_sun", "f4", 4),
        ("sun", "f4", 4),
        ("sky", "f4", (7, 4)),
        ("camera", "f4", 4),
        ("axis", "f4", 4),
        ("drift", "f4", 4),
        ("shutter", "f4", 4),
    ]
)
"""`FrameInfo` of the shaders; matrices are stored by columns there."""


def to_clip(view: View) -> Float64Array:
    """(4, 4) from positions relative to the camera to clip space, depth 1 at `NEAR_M` falling to 0 at infinity."""
    width, height = view.size_px
    right, down, forward = view.rotation.T
    aside, above = off_axis(view)
    matrix = np.zeros((4, 4))
    matrix[0, :3] = 2 * view.focal_px / width * right + aside * forward
    matrix[1, :3] = -2 * view.focal_px / height * down + above * forward
    matrix[2, 3] = NEAR_M
    matrix[3, :3] = forward
    return matrix


def off_axis(view: View) -> tuple[float, float]:
    """Where the axis goes through the image, x and y of clip space: 0, 0 unless the view is a crop."""
    x, y = (2 * view.principal_px / view.size_px - 1).tolist()
    return x, -y


@dataclass(frozen=True)
class ShadowFit:
    """Placement of the shadow map: a rectangle across the sun's rays that holds everything near and in view."""

    matrix: Float64Array
    """(4, 4) from positions relative to the camera to u, v (v down) and depth from the sun, 0 … 1."""
    size_px: int
    """Side of the map [texels]."""
    used_px: tuple[int, int]
    """Columns and rows of it, from its upper left corner on, that the rectangle takes; nothing is drawn beyond."""
    texel_m: float
    """Side of a texel, across the sun's rays."""
    across: Float64Array
    """(2, 3) axes of the rectangle, world frame."""
    middle: Float64Array
    """(2,) of the rectangle along these axes, relative to the camera [m]."""

    @property
    def half_m(self) -> Float64Array:
        """(2,) half of the rectangle's sides."""
        return np.array(self.used_px) * (self.texel_m / 2)


def seen_points(view: View, reach_m: float) -> Float64Array:
    """(n, 3) points on the rim and inside of what a view sees of the ground and of what stands on it, world frame."""
    width, height = view.size_px
    grid = np.stack(np.meshgrid(np.linspace(0, width, 7), np.linspace(0, height, 7)), axis=-1).reshape(-1, 2)
    rays = view.rays(grid)
    found = []
    for level in (0.0, min(_RECEIVER_M, max(view.position[2] - 0.5, 0.0))):
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (level - view.position[2]) / rays[:, 2]
        along[~(along > 0)] = np.inf
        limit = reach_m / np.maximum(np.linalg.norm(rays[:, :2], axis=1), 1e-9)
        along = np.minimum(along, limit)
        kept = np.isfinite(along)
        found.append(view.position + rays[kept] * along[kept, None])
    points = np.concatenate(found)
    points[:, 2] = np.clip(points[:, 2], 0, None)
    return points


def fit_shadow(view: View, light: Light) -> ShadowFit:
    """The shadow map for a view: its texels stay where they are in the world when the camera moves a little."""
    points = seen_points(view, SHADOW_REACH_M) - view.position
    sun = light.to_sun
    across = _tightest(sun, points)
    placed = points @ across.T
    low, high = placed.min(axis=0) - _MARGIN_M, placed.max(axis=0) + _MARGIN_M
    ground = points[points[:, 2] < NEAR_M - view.position[2]] @ view.rotation[:, 2]
    fine = SHADOW_TEXEL_PX * float(ground.min(initial=SHADOW_REACH_M)) / view.focal_px
    # In steps, so that shadows stay the same when the camera climbs a little.
    texel = 2.0 ** (math.floor(math.log2(max(fine, 1e-6)) * _TEXELS_AN_OCTAVE) / _TEXELS_AN_OCTAVE)
    least, most = SHADOW_PX
    texel = float(np.clip(texel, (high - low).max() / (most - 2), (high - low).max() / least))
    columns, rows = (np.ceil((high - low) / texel) + 1).astype(int).tolist()
    size = SHADOW_STEP_PX * math.ceil(max(columns, rows) / SHADOW_STEP_PX)
    home = across @ view.position
    corner = np.floor((low + home) / texel) * texel - home
    side = size * texel
    matrix = np.zeros((4, 4))
    matrix[0, :3], matrix[0, 3] = across[0] / side, -corner[0] / side
    matrix[1, :3], matrix[1, 3] = -across[1] / side, (corner[1] + rows * texel) / side
    matrix[2, :3], matrix[2, 3] = -sun / _SHADOW_DEPTH_M, 0.5
    matrix[3, 3] = 1
    middle = corner + np.array([columns, rows]) * (texel / 2)
    return ShadowFit(matrix, size, (columns, rows), texel, across, middle)


def _tightest(sun: Float64Array, points: Float64Array) -> Float64Array:
    """(2, 3) axes across the sun's rays, turned so that the rectangle along them around some points is small."""
    flat = math.hypot(sun[0], sun[1])
    first = np.array([-sun[1], sun[0], 0.0]) / flat if flat > 1e-6 else np.array([1.0, 0.0, 0.0])
    plain = np.stack([first, np.cross(sun, first)])
    angles = np.radians(np.arange(0.0, 90.0, _TURN_DEG))
    cos, sin = np.cos(angles), np.sin(angles)
    turned = np.array([[cos, sin], [-sin, cos]]).transpose(2, 0, 1) @ plain
    extent = np.ptp(points @ turned.transpose(0, 2, 1), axis=1)
    return np.asarray(turned[int(extent.prod(axis=1).argmin())])


def frame_info(view: View, light: Light, shadow: ShadowFit, *, readout_s: float) -> StructuredArray:
    """One row of `FRAME_INFO`.

    Args:
        view: its velocity moves the rows of a rolling shutter.
        readout_s: from the exposure of the first row to that of the last; 0 for all rows at once.
    """
    info = np.zeros(1, dtype=FRAME_INFO)
    clip = to_clip(view)
    info["to_clip"], info["to_shadow"] = clip.T, shadow.matrix.T
    info["to_sun"][0, :3] = light.to_sun
    info["to_sun"][0, 3] = _SHADOW_DEPTH_M * math.tan(SUN_RADIUS_RAD) / shadow.texel_m
    info["sun"][0, :3], info["sun"][0, 3] = light.sun_klux, shadow.texel_m
    # By channel; the last one's factors of all three come last.
    waves = light.sky_irradiance * _HARMONICS[:, None]
    info["sky"][0, :6] = waves[:8].T.reshape(6, 4)
    info["sky"][0, 6, :3] = waves[8]
    info["camera"][0, :3], info["camera"][0, 3] = view.position, 1 / view.focal_px
    info["axis"][0, :3], info["axis"][0, 3] = view.rotation[:, 2], light.haze_m
    info["drift"][0] = -(clip @ np.append(view.velocity_mps, 0.0))
    info["shutter"][0, 0], info["shutter"][0, 2:] = readout_s, off_axis(view)
    return info


def planes(view: View) -> Float64Array:
    """(4, 3) inward normals of the planes through the camera that bound what it sees: left, right, top, bottom."""
    left, top = view.principal_px / view.focal_px
    right, bottom = (view.size_px - view.principal_px) / view.focal_px
    bounds = np.array([[1.0, 0.0, left], [-1.0, 0.0, right], [0.0, 1.0, top], [0.0, -1.0, bottom]])
    return np.asarray(bounds / np.linalg.norm(bounds, axis=1, keepdims=True) @ view.rotation.T)


def corners(low: Float64Array, high: Float64Array) -> Float64Array:
    """(8, 3) of a box."""
    return np.where(_HIGHER, high, low)
