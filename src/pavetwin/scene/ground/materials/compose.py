"""Shading inputs of the ground: the one formula that renderers, the glTF export and tests share, in NumPy.

With uv the detail's coordinates in metres (the mesh's `uv`), p the world position, f the footprint of a pixel on the
ground [m], D(kind, uv) the detail (linear reflectance ρ, hold of paint a, normal xy n, height h, roughness r, all
0 … 1 but n), and M(p) the tile's maps, both filtered over f:

1. Detail. ρ, a, n, h, r = D(uv). So that loose kinds (LOOSE: no joints to break) do not repeat, some of their grains
   are taken at uv turned by SECOND_TURN_RAD and × SECOND_SCALE, their normals turned back: those of cells of GRAIN_M
   whose random number (`grain_noise`) is below w(p) (`second_share`). Mixed samples would be paler and softer than
   either.
2. Finish and age, ρ̄ the detail's mean, tone that of the finish × that of the maps.
   ρ ← (ρ̄ + (ρ − ρ̄) · grain) · (red, 1, blue) · tone · (1 + WARMING · (tone − 1)), as binder is bluish, bare stones and
   dust are warm; n ← n · grain · (1 − 0.45 · polish); r ← r − 0.15 · polish.
3. Dust lies in the hollows: ρ ← mix(ρ, DUST, dust · (1.15 − 0.5 · h)); n ← n · (1 − 0.5 · dust).
4. Stain (oil, rubber, damp): ρ ← ρ · (1 − 0.8 · stain); r ← r − 0.25 · stain.
5. Bitumen: its edge follows the grain, d = D_bitumen + RAGGED_M · (h − ½), its share b = smoothstep(−e, e, d) with
   e = max(BITUMEN_EDGE_M, f / 2): ρ ← mix(ρ, BITUMEN, 0.92 · b); n ← n · (1 − 0.75 · b); r ← mix(r, 0.55, b).
6. Paint: d and its share s as for bitumen, with PAINT_EDGE_M; paint does not lie on bitumen: s ← s · (1 − 0.8 · b).
   At close range its remaining share is smoothstep(t − q, t + q, a), q = KEPT_SOFT and t = wear · (1 + 2q) − q, so that
   nothing goes at wear 0 and all at 1. From afar grains are not resolved and their mean share is: clamp(1 − wear + 5 ·
   wear · (1 − wear) · (a − ½)). k mixes the two by smoothstep(GRAINS_SEEN_M, GRAINS_MELTED_M, f). Grime lies in
   hollows, tyres darken: ρ ← mix(ρ, paint · (1 − 0.35 · wear) · mix(1, tone, 0.5) · (1 − 0.5 · stain) · (1 − 0.3 ·
   polish) · (1 + 0.35 · (h − MEAN_HEIGHT)), s · k); n ← n · (1 − 0.4 · s · k); r ← mix(r, 0.6, s · k).
7. On patches of defects ρ ← ρ · (their reflectance) and their normal is added before normalising: (n + n_defect, 1).
   Where a share l of the surface is lost (open cracks, holes, broken edges), so are the sealant and the paint that lay
   on it: b ← b · (1 − l) in 5, and s ← s · (1 − l) in 6 except for plants, which grow in cracks.

Reflectances: paint and bitumen after the ranges of road lighting practice (CIE 144:2001; worn white road paint has a
luminance factor of 0.4 to 0.7, EN 1436 class B2 to B5), dust after dry mineral soil (0.25 to 0.35 in the visible).
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, FloatArray
from pavetwin.scene.ground.materials.detail_textures import details
from pavetwin.scene.ground.materials.sampling import Pyramid, linear_of_srgb, smoothstep
from pavetwin.scene.values import MAP_MARGIN_M, PLAIN_FINISH, SIGNED_DISTANCE_M, TILE_M, Finish, GroundKind, GroundMaps

LOOSE: Final = frozenset(
    {GroundKind.ASPHALT, GroundKind.GRASS, GroundKind.EARTH, GroundKind.CHIP_SEAL, GroundKind.SLABS}
)
SECOND_TURN_RAD: Final = 0.62
SECOND_SCALE: Final = 1.37
GRAIN_M: Final = 0.004

WARMING: Final = (0.04, 0.0, -0.07)
DUST: Final = (0.30, 0.265, 0.215)
BITUMEN: Final = (0.034, 0.034, 0.036)
PAINTS: Final = {
    "white": (0.555, 0.545, 0.51),
    "yellow": (0.55, 0.35, 0.06),
    "orange": (0.52, 0.17, 0.025),
    "red": (0.36, 0.035, 0.03),
    "blue": (0.045, 0.12, 0.36),
    "green": (0.06, 0.26, 0.10),
    "moss": (0.035, 0.050, 0.014),
    "grass": (0.060, 0.095, 0.025),
    "straw": (0.170, 0.140, 0.070),
}
"""In the order of the maps' numbers, evenly spaced over 0 … 1. The last three are plants in cracks: grass reflects 0.05
to 0.10 in the visible, dry grass more."""

FIRST_PLANT: Final = (list(PAINTS).index("moss") - 0.5) / (len(PAINTS) - 1)
"""From this number of the maps on it is not paint but a plant."""

RAGGED_M: Final = 0.016
"""Edges of paint and bitumen move by half of this with the height of the grain [m]."""
PAINT_EDGE_M: Final = 0.004
BITUMEN_EDGE_M: Final = 0.006

KEPT_SOFT: Final = 0.05
GRAINS_SEEN_M: Final = 0.002
GRAINS_MELTED_M: Final = 0.010
"""Paint wears off stones of 3 to 10 mm: pixels below the first size resolve them, pixels above the second do not."""

MEAN_HEIGHT: Final = 0.56
"""Mean height of asphalt's grain, 0 … 1."""


@dataclass(frozen=True)
class Surface:
    """Shading inputs at every point, all float32."""

    albedo: Float32Array
    """(..., 3) linear reflectance."""
    normal: Float32Array
    """(..., 3) unit, of ground that lies flat: x and y along the detail's u and v."""
    roughness: Float32Array
    """(...)"""


@dataclass(frozen=True)
class MapPyramids:
    """A tile's maps as mip pyramids, 0 … 1; made once for many lookups."""

    weathering: Pyramid
    drawn: Pyramid

    @classmethod
    def of(cls, maps: GroundMaps) -> "MapPyramids":
        weathering, drawn = (
            Pyramid.of(np.asarray(layer / np.float32(255), dtype=np.float32), wraps=False)
            for layer in (maps.weathering, maps.drawn)
        )
        return cls(weathering, drawn)


def surface(
    kind: GroundKind,
    uv: FloatArray,
    local_xy: FloatArray,
    origin: tuple[float, float],
    maps: GroundMaps | MapPyramids,
    footprint_m: float | FloatArray,
    finish: Finish = PLAIN_FINISH,
    lost: float | FloatArray = 0.0,
) -> Surface:
    """The surface of ground of one kind at many points.

    Args:
        kind: what the ground is made of.
        uv: (..., 2) coordinates of the detail, metres.
        local_xy: (..., 2) positions in the tile's frame, metres.
        origin: the tile's south-west corner in the world frame, metres.
        footprint_m: side of a pixel's footprint on the ground, one number or (...).
        finish: of the piece of ground.
        lost: share of the surface that is gone with the sealant and paint on it, one number or (...).
    """
    reflectance, hold, normal, height, rough = _detail(kind, uv, local_xy, origin, footprint_m)
    weathering, drawn = _maps(maps, local_xy, footprint_m)
    tone, stain, dust, polish = (weathering[..., channel] for channel in range(4))
    tone = tone * np.float32(255 / 128 * finish.tone)
    paint_m, bitumen_m = (_metres(drawn[..., channel]) for channel in (0, 3))
    which, wear = drawn[..., 1], drawn[..., 2]

    reflectance, normal = _grained(kind, reflectance, finish.grain), normal * np.float32(finish.grain)
    shade = np.array([finish.red, 1.0, finish.blue]) * (1.0 + np.array(WARMING) * (tone[..., None] - 1.0))
    albedo = np.asarray(reflectance * tone[..., None] * shade, dtype=np.float32)
    normal = np.asarray(normal * (1.0 - 0.45 * polish)[..., None], dtype=np.float32)
    rough = rough - 0.15 * polish
    albedo = _mix(albedo, DUST, np.clip(dust * (1.15 - 0.5 * height), 0.0, 1.0))
    normal = normal * (1.0 - 0.5 * dust)[..., None]
    albedo = albedo * (1.0 - 0.8 * stain)[..., None]
    rough = rough - 0.25 * stain

    sealed = _share(bitumen_m, height, BITUMEN_EDGE_M, footprint_m) * (1 - np.asarray(lost, dtype=np.float32))
    albedo = _mix(albedo, BITUMEN, 0.92 * sealed)
    rough = rough + (0.55 - rough) * sealed
    normal = normal * (1.0 - 0.75 * sealed)[..., None]

    painted = _share(paint_m, height, PAINT_EDGE_M, footprint_m) * _kept(hold, wear, footprint_m) * (1 - 0.8 * sealed)
    painted = painted * (1 - np.where(which > FIRST_PLANT, np.float32(0), np.asarray(lost, dtype=np.float32)))
    dirt = (1.0 - 0.35 * wear) * (0.5 + 0.5 * tone) * (1.0 - 0.5 * stain) * (1.0 - 0.3 * polish)
    dirt = dirt * (1.0 + 0.35 * (height - MEAN_HEIGHT))
    places = np.linspace(0.0, 1.0, len(PAINTS))
    colour = np.stack([np.interp(which, places, band) for band in zip(*PAINTS.values(), strict=True)], axis=-1)
    albedo = _mix(albedo, np.asarray(colour * dirt[..., None], dtype=np.float32), painted)
    rough = rough + (0.6 - rough) * painted
    level = normal * (1.0 - 0.4 * painted)[..., None]
    up = np.concatenate([level, np.ones((*level.shape[:-1], 1), dtype=np.float32)], axis=-1)
    return Surface(
        albedo=np.asarray(np.clip(albedo, 0.0, 1.0), dtype=np.float32),
        normal=np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True), dtype=np.float32),
        roughness=np.asarray(np.clip(rough, 0.05, 1.0), dtype=np.float32),
    )


def mean_reflectance(kind: GroundKind) -> Float32Array:
    """(3,) of a kind's detail."""
    _, pyramid = _pyramids(kind)
    return np.asarray(pyramid.levels[-1][0, 0, :3])


def _grained(kind: GroundKind, reflectance: Float32Array, grain: float) -> Float32Array:
    """With the contrast of its grain changed."""
    mean = mean_reflectance(kind)
    return np.asarray(np.maximum(mean + (reflectance - mean) * np.float32(grain), 0.0), dtype=np.float32)


def second_share(xy: FloatArray) -> Float32Array:
    """w(p) = smoothstep(0.4, 0.6, ½ + 0.17 Σ wave(…)): where the second sample of a detail shows, (...)."""
    x, y = xy[..., 0], xy[..., 1]
    waves = wave(0.068 * x + 0.049 * y) + wave(-0.094 * x + 0.123 * y + 0.207) + wave(0.180 * x - 0.059 * y + 0.653)
    return smoothstep(0.4, 0.6, 0.5 + 0.17 * waves)


def wave(turns: FloatArray) -> Float32Array:
    """Approximate sine of an angle in turns, from parabolas: cheaper per pixel than sines."""
    ahead = 1 - 2 * (turns - np.floor(turns))
    return np.asarray(4 * ahead * (1 - np.abs(ahead)), dtype=np.float32)


def grain_noise(local_xy: FloatArray) -> Float32Array:
    """0 … 1 of each cell of GRAIN_M of a tile, (...): the cell's column and row hashed in 32 bits, the same on every
    device."""
    cells = np.floor(np.asarray(local_xy, dtype=np.float32) / np.float32(GRAIN_M)).astype(np.int64).astype(np.uint32)
    mixed = (cells[..., 0] * np.uint32(1597334677)) ^ (cells[..., 1] * np.uint32(3812015801))
    mixed = (mixed ^ (mixed >> np.uint32(16))) * np.uint32(2246822519)
    return np.asarray((mixed >> np.uint32(8)) / np.float32(1 << 24), dtype=np.float32)


@cache
def _pyramids(kind: GroundKind) -> tuple[float, Pyramid]:
    """A detail's size and its nine channels: reflectance, hold, normal xy, height, roughness."""
    detail = details()[kind]
    coded, relief = detail.reflectance / np.float32(255), detail.relief.astype(np.float32)
    channels = (linear_of_srgb(coded[..., :3]), coded[..., 3:], (relief[..., :2] - 128) / 127, relief[..., 2:] / 255)
    return detail.size_m, Pyramid.of(np.concatenate(channels, axis=-1), wraps=True)


def _detail(
    kind: GroundKind, uv: FloatArray, local_xy: FloatArray, origin: tuple[float, float], footprint_m: float | FloatArray
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array, Float32Array]:
    size_m, pyramid = _pyramids(kind)
    scale, footprint = np.full(uv.shape[:-1], 1 / size_m), np.asarray(footprint_m)
    cos, sin = np.ones_like(scale), np.zeros_like(scale)
    if kind in LOOSE:
        second = second_share(local_xy + np.asarray(origin)) > grain_noise(local_xy)
        scale = np.where(second, SECOND_SCALE, 1.0) / size_m
        cos, sin = np.where(second, math.cos(SECOND_TURN_RAD), 1.0), np.where(second, math.sin(SECOND_TURN_RAD), 0.0)
    u, v = uv[..., 0] * scale, uv[..., 1] * scale
    found = pyramid.sample(np.stack([cos * u - sin * v, sin * u + cos * v], axis=-1), footprint * scale)
    x, y = found[..., 4].copy(), found[..., 5].copy()
    found[..., 4], found[..., 5] = cos * x + sin * y, -sin * x + cos * y
    return found[..., :3], found[..., 3], found[..., 4:6], found[..., 6], found[..., 7]


def _maps(
    maps: GroundMaps | MapPyramids, local_xy: FloatArray, footprint_m: float | FloatArray
) -> tuple[Float32Array, Float32Array]:
    """Both maps at positions, (..., 4) each, 0 … 1."""
    pyramids = MapPyramids.of(maps) if isinstance(maps, GroundMaps) else maps
    side = TILE_M + 2 * MAP_MARGIN_M
    uv, footprint = (local_xy + MAP_MARGIN_M) / side, np.asarray(footprint_m) / side
    return pyramids.weathering.sample(uv, footprint), pyramids.drawn.sample(uv, footprint)


def _metres(coded: Float32Array) -> Float32Array:
    """A signed distance from its value 0 … 1 in a map."""
    return np.asarray((coded * 255 - 128) / 127 * SIGNED_DISTANCE_M, dtype=np.float32)


def _share(
    distance_m: Float32Array, height: Float32Array, edge_m: float, footprint_m: float | FloatArray
) -> Float32Array:
    """Share of a pixel inside an outline whose edge follows the grain."""
    edge = np.maximum(edge_m, np.asarray(footprint_m, dtype=np.float32) / 2)
    return smoothstep(-edge, edge, distance_m + RAGGED_M * (height - 0.5))


def _kept(hold: Float32Array, wear: Float32Array, footprint_m: float | FloatArray) -> Float32Array:
    """Remaining share of the paint."""
    threshold = wear * (1.0 + 2.0 * KEPT_SOFT) - KEPT_SOFT
    near = smoothstep(threshold - KEPT_SOFT, threshold + KEPT_SOFT, hold)
    far = np.clip(1.0 - wear + 5.0 * wear * (1.0 - wear) * (hold - 0.5), 0.0, 1.0)
    return np.asarray(near + (far - near) * smoothstep(GRAINS_SEEN_M, GRAINS_MELTED_M, footprint_m), dtype=np.float32)


def _mix(albedo: Float32Array, other: tuple[float, float, float] | Float32Array, share: Float32Array) -> Float32Array:
    return np.asarray(albedo + (np.asarray(other, dtype=np.float32) - albedo) * share[..., None], dtype=np.float32)
