"""Tiles that a frame needs: those in view, and those that cast shadows into it."""

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.render.projection import planes, seen_points
from pavetwin.scene.light import Light
from pavetwin.scene.values import TILE_M, TileKey, tile_origin
from pavetwin.scene.view import View

if TYPE_CHECKING:
    from pavetwin.render.tile_cache import Drawable  # which draws, and so loads the device's library
    from pavetwin.scene.scene import Scene

FAR_M: Final = 150.0
"""Nothing farther away is drawn."""

CLEAR_SHARE: Final = 0.01
"""Haze is not drawn up to this share of its 1/e distance: 30 m on a clear day."""

_STEEP: Final = math.cos(math.radians(50))
"""Cosine to the vertical; ground that is seen at a flatter angle may reflect what is near the horizon."""

_WIDE_M: Final = 40.0  # A view with a larger ground radius looks along a street; its shadow casters are in view
_CASTERS_UP_TO_M: Final = 20.0  # Greatest height of shadow casters outside the image [m]
_CASTERS_REACH_M: Final = 48.0  # Their greatest distance from the image's edge [m]
_STEP_M: Final = 12.0


def wanted_keys(scene: "Drawable", view: View, light: Light) -> tuple[TileKey, ...]:
    """The keys of the tiles to draw for a view under a light."""
    points = seen_points(view, FAR_M)[:, :2]
    x, y = ((points.min(axis=0) + points.max(axis=0)) / 2).tolist()
    radius = float(np.linalg.norm(points - (x, y), axis=1).max())
    found: dict[TileKey, None] = {}
    if radius < _WIDE_M:
        steep = math.tan(math.radians(light.sun_elevation_deg))
        reach = min(_CASTERS_UP_TO_M / steep, _CASTERS_REACH_M) if light.sun_klux.any() else 0.0
        east, north = (light.to_sun[:2] / max(float(np.linalg.norm(light.to_sun[:2])), 1e-9)).tolist()
        for way in np.arange(0, reach + _STEP_M, _STEP_M).tolist():
            found |= dict.fromkeys(scene.keys_near(x + east * way, y + north * way, radius))
        return tuple(found)
    bounds = planes(view)
    x, y = view.position[:2].tolist()
    for key in scene.keys_near(x, y, FAR_M):
        if tile_seen(tile_origin(key), view, bounds):
            found[key] = None
    return tuple(found | dict.fromkeys(scene.keys_near(x, y, _STEP_M)))


def tile_seen(origin: tuple[float, float], view: View, bounds: Float64Array) -> bool:
    """Whether a tile and its objects, up to 30 m high and 10 m beyond its edge, may be in the image.

    `origin`: its south-west corner, metres; `bounds`: the view's `projection.planes`.
    """
    return _seen((origin[0], origin[1], origin[0] + TILE_M, origin[1] + TILE_M), 10.0, 30.0, view, bounds)


def ground_seen(box: tuple[float, float, float, float], view: View, bounds: Float64Array) -> bool:
    """Whether ground may be in the image, also when a rolling shutter shifts it a little.

    `box`: west, south, east, north, metres; `bounds`: the view's `projection.planes`.
    """
    return _seen(box, 1.0, 1.0, view, bounds)


def pavement_seen(origin: tuple[float, float], view: View, bounds: Float64Array) -> bool:
    """Whether the ground of a tile may be in the image; the arguments are those of `tile_seen`."""
    return ground_seen((*origin, origin[0] + TILE_M, origin[1] + TILE_M), view, bounds)


def _seen(
    box: tuple[float, float, float, float], beyond_m: float, height_m: float, view: View, bounds: Float64Array
) -> bool:
    west, south, east, north = box
    low = np.array([west - beyond_m, south - beyond_m, -1.0]) - view.position
    high = np.array([east + beyond_m, north + beyond_m, height_m]) - view.position
    furthest = np.where(bounds > 0, high, low)
    return bool((np.einsum("ni,ni->n", bounds, furthest) > 0).all())


def make_missing(scene: "Scene", view: View, light: Light) -> None:
    """Add to the scene's cache what a frame needs and the cache misses. What the renderer requests last comes first,
    as it may be at work at the same time."""
    bounds = planes(view)
    for key in reversed(wanted_keys(scene, view, light)):
        origin = tile_origin(key)
        is_seen = tile_seen(origin, view, bounds) and pavement_seen(origin, view, bounds)
        holes = scene.holes_on(key).items() if is_seen else ()
        scene.make_missing(key, [number for number, box in holes if ground_seen(box, view, bounds)], ground=is_seen)


def looks_beyond(view: View) -> bool:
    """Whether any of a view's corners misses the ground that is drawn."""
    rays = _corner_rays(view)
    down = np.maximum(-rays[:, 2], 1e-9)
    away = np.linalg.norm(rays[:, :2], axis=1) * view.position[2] / down
    return bool((away > 0.8 * FAR_M).any())


def looks_down(view: View, light: Light) -> bool:
    """Whether all of a view is ground seen from above, and none of it through haze."""
    rays = _corner_rays(view)
    steepness = float((-rays[:, 2] / np.linalg.norm(rays, axis=1)).min())
    return steepness > _STEEP and bool(view.position[2] / steepness < CLEAR_SHARE * light.haze_m)


def _corner_rays(view: View) -> Float64Array:
    width, height = view.size_px
    return view.rays([[0, 0], [width, 0], [0, height], [width, height]])
