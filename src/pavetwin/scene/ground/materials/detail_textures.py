"""Detail textures of every kind of ground, made from a fixed seed: the same in every world."""

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from os import cpu_count
from types import MappingProxyType
from typing import Final

import numpy as np

from pavetwin.arrays import AnyArray, Float32Array, FloatArray, Int64Array
from pavetwin.memory import give_back
from pavetwin.scene.ground.materials.grain import SIDE_PX, blurred, cells, detail, float32, noise, stones
from pavetwin.scene.texture_cache import kept
from pavetwin.scene.values import Detail, GroundKind
from pavetwin.seeds import Stream, child

SIZE_M: Final = 2.0


SEGREGATION: Final = ((0.022, 0.070), (0.055, 0.095))
"""Wavelengths [m] and standard deviations of the mix's own changes of reflectance. Stones alone average out over a few
centimetres; in photographs of pavements the deviation falls with the scale s as s^-0.35. Ours, after photographs."""


@dataclass(frozen=True)
class StoneMix:
    """Stones and binder of a pavement."""

    stones: tuple[tuple[float, float], ...]  # Radius [m] and share of the surface for each size
    reflectance: float  # Mean over the surface
    depth_m: float  # From the floor of voids to the tops of stones
    mastic: float  # Reflectance of what is between the stones, where theirs is about 0.15
    filmed: float  # By how much binder darkens the stones that it still covers
    hollow: float  # Contrast of the hollows between stones, which see little of the sky and hold grime
    pits_per_m2: float  # Stones that have left the surface


DENSE: Final = StoneMix(
    stones=((5.2e-3, 0.16), (3.6e-3, 0.24), (2.4e-3, 0.30), (1.6e-3, 0.16)),
    reflectance=0.135,
    depth_m=1.6e-3,
    mastic=0.085,
    filmed=0.42,
    hollow=2.3,
    pits_per_m2=26,
)
"""Aged AC 11 (EN 13108-1), stones up to about 11 mm. Reflectance: 0.10 to 0.20 are measured (Li, Harvey, Kendall 2013,
Building and Environment 59); the mean texture depth of dense asphalt is about half of the depth here."""

CHIPS: Final = StoneMix(
    stones=((5.6e-3, 0.62), (4.4e-3, 0.45), (3.2e-3, 0.12)),
    reflectance=0.15,
    depth_m=3.4e-3,
    mastic=0.045,
    filmed=0.30,
    hollow=3.2,
    pits_per_m2=90,
)
"""A surface dressing of single-size chips of 8 to 11 mm. Ours."""


def _bound(mix: StoneMix, rng: np.random.Generator) -> Detail:
    """Stones in binder."""
    texel_m = SIZE_M / SIDE_PX
    radii = []
    for radius_m, share in mix.stones:
        count = int(share * SIZE_M**2 / (np.pi * radius_m**2 * 0.8))
        radii.append(radius_m * (0.8 + 0.4 * rng.random(count)) / texel_m)
    height, number, rim = stones(rng, np.concatenate(radii).astype(np.float32), depth=0.75)
    stone = height > 0
    fine = noise(rng, 3.0)
    filmed = 0.5 + 0.5 * np.tanh(0.45 * noise(rng, 40.0, octaves=1.5) + 6.0 * (number - 0.55))
    tint = np.modf(number * 97.0)[0]
    kind = np.modf(number * 1013.0)[0]
    bright = 0.150 * np.exp(0.47 * (np.modf(number * 331.0)[0] - 0.5) * 2.0) + 0.05 * (kind > 0.965)
    bright = bright * (1.0 - mix.filmed * filmed) * (1.0 - 0.25 * rim**4)
    warm = np.stack([1.0 + 0.16 * (tint - 0.42), np.ones_like(tint), 1.0 - 0.20 * (tint - 0.42)], axis=-1)
    mastic = mix.mastic * (1.0 + 0.16 * fine)
    albedo = np.where(stone[..., None], bright[..., None] * warm, mastic[..., None] * np.array([1.01, 1.0, 0.985]))
    ground = 0.34 + 0.05 * noise(rng, 7.0) + 0.03 * fine
    level = np.where(stone, 0.18 + 0.82 * height, ground)
    pits = _pits(rng, mix.pits_per_m2)
    level = np.clip(level * (1.0 - pits), 0.0, 1.0)
    # Hollows see little of the sky: they are darker and hold grime.
    hollow = np.clip((blurred(level, 2.2) - level) * mix.hollow, 0.0, 0.72)
    albedo = albedo * (1.0 - hollow)[..., None] * (1.0 - 0.88 * pits)[..., None]
    albedo = albedo * (1.0 + 0.022 * noise(rng, 45.0, octaves=1.8) + _segregation(rng, texel_m))[..., None]
    roughness = np.clip(0.86 - 0.12 * stone * (1 - filmed) + 0.04 * fine, 0.5, 1.0)
    return detail(SIZE_M, albedo, level, roughness, _hold(rng, level), mix.depth_m, mix.reflectance)


def _segregation(rng: np.random.Generator, texel_m: float) -> Float32Array:
    """Share by which the mix is paler or darker over a few stones, as paving leaves it: crowds of coarse or of fine
    stones, of more or less binder."""
    found = np.zeros((SIDE_PX, SIDE_PX), dtype=np.float32)
    for wavelength_m, deviation in SEGREGATION:
        found += np.float32(deviation) * noise(rng, wavelength_m / texel_m, octaves=0.8)
    return found


def _pits(rng: np.random.Generator, per_m2: float) -> Float32Array:
    """Where single stones have left the surface, 0 … 1."""
    count = int(per_m2 * SIZE_M**2)
    radius = (rng.gamma(6.0, 0.55e-3, count) + 1.2e-3) / (SIZE_M / SIDE_PX)
    depth, _, _ = stones(rng, radius.astype(np.float32), depth=0.7)
    return np.clip(blurred(depth, 0.6), 0.0, 1.0) * np.float32(0.85)


def _hold(rng: np.random.Generator, level: Float32Array) -> Float32Array:
    """Order in which paint wears off: tops of stones and random grains first, then along its own cracks, then
    flakes."""
    warp = np.stack([6.0 * noise(rng, 60.0), 6.0 * noise(rng, 60.0)], axis=-1)
    border, _ = cells(rng, 26, warp)
    crack = np.exp(-((border / 1.0) ** 2)) * np.clip(0.4 + 0.5 * noise(rng, 120.0), 0.0, 1.0)
    tops = blurred(level, 0.7)
    tops = (tops - tops.mean()) / tops.std()
    flakes = np.clip(noise(rng, 55.0, octaves=1.4) - 2.1, 0.0, 0.6)
    slow = 0.22 * noise(rng, 18.0) + 0.18 * noise(rng, 90.0)
    return np.asarray(slow - 0.75 * tops + 0.5 * noise(rng, 3.2) - 1.5 * crack - 2.5 * flakes, dtype=np.float32)


BLOCK_M: Final = 0.10  # Width of a paving block of 200 × 100 mm (EN 1338 and EN 1344), twice as long as wide
BLOCKS: Final = 16  # Widths of blocks over the texture: herringbone repeats every four
TILE_M: Final = 0.25
TILES: Final = 8
GROOVES: Final = 4
"""Grooves in the face of a tile, along its side."""

SETT_M: Final = 0.10
SETTS: Final = 16
"""Courses of setts over the texture; each course has as many stones (EN 1342: 50 to 300 mm)."""

BLOCK_REFLECTANCE: Final = 0.24
TILE_REFLECTANCE: Final = 0.27
SETT_REFLECTANCE: Final = 0.20
"""Concrete products weather to 0.20 to 0.30, granite has 0.15 to 0.25 (as `hardscape`)."""

SAND: Final = (0.30, 0.27, 0.22)
SHADED: Final = 0.42
"""Share of its light that reaches the sand in a joint."""
MOSS: Final = (0.09, 0.13, 0.045)


def blocks(rng: np.random.Generator) -> Detail:
    """Paving blocks in herringbone bond at right angles to the street, each of its own shade."""
    size_m = BLOCK_M * BLOCKS
    rows, columns = _places(rng, 0.25)
    pitch = SIDE_PX / BLOCKS
    x, y = columns / pitch, rows / pitch
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    # Along a row two cells lie in one block across, and the next two each in a block along the street.
    place = (i - j) % 4
    left, low = i - (place == 1), j - (place == 2)
    lies = place < 2
    wide, high = np.where(lies, 2, 1), np.where(lies, 1, 2)
    border_m = _border(x - left, y - low, wide, high) * BLOCK_M
    shade = rng.standard_normal((BLOCKS, BLOCKS))[low % BLOCKS, left % BLOCKS]
    level = rng.standard_normal((BLOCKS, BLOCKS))[low % BLOCKS, left % BLOCKS]
    return _laid(rng, size_m, border_m, shade, level, joint_m=0.005, contrast=0.11, mean=BLOCK_REFLECTANCE)


def tiles(rng: np.random.Generator) -> Detail:
    """Square tiles with grooves along the street, of two shades in courses; every fourth course is the darker."""
    rows, columns = _places(rng, 0.2)
    x, y = columns / (SIDE_PX / TILES), rows / (SIDE_PX / TILES)
    i, j = np.floor(x).astype(int) % TILES, np.floor(y).astype(int) % TILES
    border_m = _border(x % 1.0, y % 1.0, 1, 1) * TILE_M
    each = rng.standard_normal((TILES, TILES))[j, i]
    shade = 0.6 * each - 4.0 * (j % 4 == 0)
    groove = np.clip(1.0 - np.abs((y * GROOVES) % 1.0 - 0.5) * TILE_M / GROOVES / 0.004, 0.0, 1.0)
    level = rng.standard_normal((TILES, TILES))[j, i]
    laid = partial(_laid, joint_m=0.005, contrast=0.09, mean=TILE_REFLECTANCE, groove=groove)
    return laid(rng, TILE_M * TILES, border_m, shade, level)


def setts(rng: np.random.Generator) -> Detail:
    """Split granite setts in courses across the street, with rounded heads and wide joints."""
    rows, columns = _places(rng, 0.9)
    pitch = SIDE_PX / SETTS
    y = rows / pitch
    course = np.floor(y).astype(int) % SETTS
    widths = 0.75 + 0.5 * rng.random((SETTS, SETTS))
    ends = np.cumsum(widths, axis=1)
    ends *= SETTS / ends[:, -1:]
    x = (columns / pitch + (SETTS * rng.random(SETTS))[course]) % SETTS
    number = (x[..., None] >= ends[course][..., :-1]).sum(axis=-1)
    right = ends[course, number]
    left = np.where(number > 0, ends[course, np.maximum(number - 1, 0)], 0.0)
    border_m = _border(x - left, y % 1.0, right - left, 1) * SETT_M
    shade, level = (values[course, number] for values in rng.standard_normal((2, SETTS, SETTS)))
    dome = blurred(float32(np.clip(border_m / (0.3 * SETT_M), 0.0, 1.0)), 5.0)
    laid = partial(_laid, joint_m=0.012, contrast=0.13, mean=SETT_REFLECTANCE, dome=0.3 * dome)
    return laid(rng, SETT_M * SETTS, border_m, shade, level)


def _places(rng: np.random.Generator, bent_px: float) -> tuple[Float32Array, Float32Array]:
    """Row and column of each texel [texels], bent a little: nothing is laid exactly."""
    rows, columns = np.meshgrid(np.arange(SIDE_PX) + 0.5, np.arange(SIDE_PX) + 0.5, indexing="ij")
    return float32(rows + bent_px * noise(rng, 110.0)), float32(columns + bent_px * noise(rng, 110.0))


def _border(
    u: FloatArray, v: FloatArray, wide: FloatArray | Int64Array | int, high: FloatArray | Int64Array | int
) -> FloatArray:
    """Distance to the nearest side of a piece of `wide` × `high`, for places in it."""
    return np.minimum(np.minimum(u, wide - u), np.minimum(v, high - v))


def _laid(
    rng: np.random.Generator,
    size_m: float,
    border_m: FloatArray,
    shade: FloatArray,
    level: FloatArray,
    *,
    joint_m: float,
    contrast: float,
    mean: float,
    groove: FloatArray | float = 0.0,
    dome: FloatArray | float = 0.0,
) -> Detail:
    """Textures of pieces laid in sand.

    Args:
        size_m: side of the texture.
        border_m: (k, k) distance to the piece's side.
        shade: (k, k) of the piece, unit deviation.
        level: (k, k) by how much it lies higher, unit deviation.
        joint_m: width of a joint.
        contrast: change of the reflectance with one unit of shade.
        mean: reflectance.
        groove: (k, k) share 0 … 1 of a groove in the face.
        dome: (k, k) height of a rounded head.
    """
    texel_m = size_m / SIDE_PX
    chips = 0.0015 * np.clip(noise(rng, 0.03 / texel_m) - 1.0, 0.0, 2.0)
    joint = np.clip(1.0 - (border_m - joint_m / 2 - chips) / (1.2 * texel_m), 0.0, 1.0)
    clouds, sand = noise(rng, 0.3 / texel_m, octaves=1.4), noise(rng, 3.2, octaves=0.8)
    speck, number, _ = stones(rng, (0.9 + 1.0 * rng.random(60_000)).astype(np.float32), depth=0.6)
    grit = np.where(speck > 0, 0.16 * (number - 0.5), 0.0)
    grime = 0.10 * np.exp(-np.maximum(border_m, 0.0) / 0.012)
    value = 1.0 + contrast * shade + 0.045 * clouds + 0.05 * sand + grit - grime - 0.25 * np.asarray(groove)
    warmth = 0.012 * shade
    albedo = np.stack([value * (1.02 + warmth), value, value * (0.95 - warmth)], axis=-1)
    moss = np.clip(0.55 * noise(rng, 0.3 / texel_m) - 0.1, 0.0, 0.8)[..., None]
    filling = (np.array(SAND) * SHADED * (1 - moss) + np.array(MOSS) * moss) / mean
    albedo = albedo * (1.0 - joint[..., None]) + filling * joint[..., None]
    face = 0.55 + np.asarray(dome) + 0.03 * sand + 0.04 * level - 0.2 * np.asarray(groove)
    height = np.clip(face * (1.0 - 0.7 * joint), 0.0, 1.0)
    roughness = np.clip(0.82 + 0.04 * sand, 0.4, 1.0)
    hold = blurred(float32(height), 1.0) + 0.1 * clouds
    return detail(size_m, float32(np.maximum(albedo, 0.02)), float32(height), float32(roughness), hold, 8e-3, mean)


CONCRETE_M: Final = 2.0
CONCRETE_REFLECTANCE: Final = 0.29
"""Weathered cement concrete 0.25 to 0.35 (Levinson, Akbari 2002, Cement and Concrete Research 32)."""

STONES: Final = 0.65
"""Range of the reflectance of bare stones, × that of the concrete: from dark basalt to white quartz. Ours."""

SLAB_M: Final = 0.40
SLABS: Final = 6
JOINT_M: Final = 0.006
PAVING_REFLECTANCE: Final = 0.26

KERB_M: Final = 2.0
KERB_STONES: Final = 2
"""Over KERB_M: kerb units of 1 m (EN 1340)."""
KERB_REFLECTANCE: Final = 0.28


def concrete(rng: np.random.Generator) -> Detail:
    """Broomed concrete: fine ridges across, sand, small voids, slow clouds, a joint sawn every 2 m."""
    clouds, sand, broom, voids = _cement(rng, CONCRETE_M)
    rows, columns = np.meshgrid(np.arange(SIDE_PX), np.arange(SIDE_PX), indexing="ij")
    bend = 0.6 * noise(rng, 60.0)
    border = np.minimum(*(np.minimum(at, SIDE_PX - at) for at in (rows + bend, columns + bend))) * (
        CONCRETE_M / SIDE_PX
    )
    joint = np.clip(1.0 - (border - 0.003) / 0.003, 0.0, 1.0)
    grime = 0.06 * np.exp(-np.maximum(border, 0.0) / 0.05)
    albedo = _coloured(1.0 + 0.028 * clouds + 0.07 * sand - 0.5 * voids - grime, 0.012 * noise(rng, 200.0))
    albedo = float32(albedo * (1.0 - 0.7 * joint)[..., None])
    height = float32(np.clip(0.6 + 0.05 * sand + 0.09 * broom - 0.6 * voids - 0.5 * joint, 0.0, 1.0))
    hold = blurred(-height, 1.0) + 0.12 * clouds
    return detail(CONCRETE_M, albedo, height, _rough(0.82, sand), hold, 1.0e-3, CONCRETE_REFLECTANCE)


def slabs(rng: np.random.Generator) -> Detail:
    """Concrete of a carriageway: its broomed skin worn off, sand and some stones bare, small voids."""
    clouds, sand, broom, voids = _cement(rng, CONCRETE_M)
    radius = (2.0e-3 + 6.0e-3 * rng.random(26_000) ** 2) / (CONCRETE_M / SIDE_PX)
    stone, number, rim = stones(rng, radius.astype(np.float32), depth=0.5)
    worn = np.clip(0.85 + 0.5 * noise(rng, 160.0), 0.0, 1.0)
    bare = np.where(stone > 0, worn * np.clip(4.0 * (1.0 - rim), 0.0, 1.0), 0.0)
    value = 1.0 + 0.035 * clouds + 0.085 * sand + 0.02 * broom - 0.55 * voids + STONES * bare * (number - 0.55)
    albedo = _coloured(float32(value), 0.014 * noise(rng, 200.0))
    height = float32(np.clip(0.6 + 0.06 * sand + 0.03 * broom - 0.6 * voids + 0.06 * bare, 0.0, 1.0))
    hold = blurred(-height, 1.0) + 0.12 * clouds
    return detail(CONCRETE_M, albedo, height, _rough(0.82, sand), hold, 1.0e-3, CONCRETE_REFLECTANCE)


def paving(rng: np.random.Generator) -> Detail:
    """Concrete slabs in half bond, each a little darker, lower or more tilted than the next; earth in their joints."""
    size_m = SLAB_M * SLABS
    pitch = SIDE_PX / SLABS
    rows, columns = np.meshgrid(np.arange(SIDE_PX) + 0.5, np.arange(SIDE_PX) + 0.5, indexing="ij")
    bend = 0.3 * noise(rng, 90.0)
    row = np.floor(rows / pitch).astype(int)
    shifted = columns + (row % 2) * pitch / 2
    column = np.floor(shifted / pitch).astype(int) % SLABS
    across, along = (shifted % pitch) + bend, (rows % pitch) + bend
    border = np.minimum(np.minimum(across, pitch - across), np.minimum(along, pitch - along)) * (size_m / SIDE_PX)
    chips = 0.0025 * np.clip(noise(rng, 25.0) - 1.2, 0.0, 2.0)
    joint = np.clip(1.0 - (border - JOINT_M / 2 - chips) / 0.004, 0.0, 1.0)
    shade, tilt_x, tilt_y, level = (values[row, column] for values in rng.standard_normal((4, SLABS, SLABS)))
    clouds, sand, _, voids = _cement(rng, size_m)
    grime = np.exp(-np.maximum(border, 0.0) / 0.025)
    albedo = _coloured(1.0 + 0.065 * shade + 0.05 * clouds + 0.08 * sand - 0.4 * voids - 0.10 * grime, 0.010 * shade)
    moss = np.clip(0.5 + 0.5 * noise(rng, 160.0), 0.0, 1.0)[..., None]
    filling = np.array([0.34, 0.31, 0.25]) * (1 - 0.5 * moss) + np.array([0.10, 0.15, 0.05]) * 0.5 * moss
    albedo = albedo * (1.0 - joint[..., None]) + filling * joint[..., None]
    slope = tilt_x * (across / pitch - 0.5) + tilt_y * (along / pitch - 0.5)
    height = np.clip(0.72 + 0.02 * sand + 0.05 * level + 0.06 * slope - 0.2 * voids - 0.55 * joint, 0.0, 1.0)
    hold = float32(height + 0.1 * clouds)
    return detail(size_m, float32(albedo), float32(height), _rough(0.84, sand), hold, 6e-3, PAVING_REFLECTANCE)


def kerb(rng: np.random.Generator) -> Detail:
    """Kerb stones along u with mortar joints; v runs up the face and over the top."""
    pitch = SIDE_PX // KERB_STONES
    columns = np.meshgrid(np.arange(SIDE_PX), np.arange(SIDE_PX))[0]
    bend = 0.8 * noise(rng, 60.0)
    along = (columns + bend) % pitch
    border = np.minimum(along, pitch - along) * (KERB_M / SIDE_PX)
    chips = 0.006 * np.clip(noise(rng, 20.0) - 1.0, 0.0, 2.0)
    joint = np.clip(1.0 - (border - 0.005 - chips) / 0.004, 0.0, 1.0)
    clouds, sand, _, voids = _cement(rng, KERB_M)
    shade = rng.standard_normal(KERB_STONES)[(columns // pitch)]
    speck, number, _ = stones(rng, (1.2 + 1.2 * rng.random(60_000)).astype(np.float32), depth=0.6)
    granite = np.where(speck > 0, 0.22 * (number - 0.5), 0.0)
    albedo = _coloured(1.0 + 0.06 * shade + 0.07 * clouds + 0.04 * sand + granite - 0.4 * voids, 0.008 * clouds)
    albedo = albedo * (1.0 - 0.68 * joint)[..., None]
    height = np.clip(0.75 + 0.04 * sand - 0.3 * voids - 0.5 * joint, 0.0, 1.0)
    hold = float32(height + 0.1 * clouds)
    return detail(KERB_M, float32(albedo), float32(height), _rough(0.78, sand), hold, 4e-3, KERB_REFLECTANCE)


def _cement(rng: np.random.Generator, size_m: float) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """Slow clouds, sand and broom ridges of unit deviation, and small voids 0 … 1."""
    texel_m = size_m / SIDE_PX
    clouds = noise(rng, 0.35 / texel_m, octaves=1.4)
    sand = noise(rng, 3.2, octaves=0.8)
    broom = noise(rng, 4.5, along=8.0, octaves=0.8)
    bubbles, _, _ = stones(rng, (0.8 + rng.gamma(2.0, 0.35, int(220 * size_m**2))).astype(np.float32), depth=0.8)
    return clouds, sand, broom, np.clip(blurred(bubbles, 0.5), 0.0, 1.0)


def _coloured(value: Float32Array, warmth: Float32Array) -> Float32Array:
    """Grey with a little more or less yellow, (..., 3)."""
    return float32(np.stack([value * (1.03 + warmth), value, value * (0.93 - warmth)], axis=-1))


def _rough(level: float, sand: Float32Array) -> Float32Array:
    return float32(np.clip(level + 0.04 * sand, 0.4, 1.0))


GRASS_REFLECTANCE: Final = 0.085
"""Mean over the visible of mown grass: green about 0.10, red and blue about half (ASTER/ECOSTRESS spectral library)."""
EARTH_REFLECTANCE: Final = 0.17


def grass(rng: np.random.Generator) -> Detail:
    """A trodden lawn: blades in tufts, some dry, bare spots."""
    blades = np.zeros((SIDE_PX, SIDE_PX), dtype=np.float32)
    for along in (7.0, 1.0 / 7.0, 3.0, 1.0 / 3.0):
        blades = np.maximum(blades, noise(rng, 3.5, along=along, octaves=0.7))
    tufts, clumps = noise(rng, 28.0), noise(rng, 150.0, octaves=1.2)
    bare = np.clip(0.9 * clumps + 0.4 * tufts - 1.35, 0.0, 1.0)
    dry = np.clip(0.28 + 0.22 * noise(rng, 80.0) + 0.25 * noise(rng, 6.0), 0.0, 1.0)[..., None]
    green, straw = np.array([0.062, 0.105, 0.032]), np.array([0.19, 0.165, 0.085])
    light = np.exp(0.34 * (blades - 1.0) + 0.16 * tufts)[..., None]
    albedo = (green * (1.0 - dry) + straw * dry) * light
    albedo = albedo * (1.0 - bare[..., None]) + np.array([0.15, 0.12, 0.085]) * bare[..., None]
    height = np.clip(0.42 + 0.15 * (blades - 1.0) + 0.12 * tufts - 0.3 * bare, 0.0, 1.0)
    rough = np.full_like(height, 0.9)
    return detail(SIZE_M, float32(albedo), float32(height), float32(rough), float32(-height), 0.012, GRASS_REFLECTANCE)


def earth(rng: np.random.Generator) -> Detail:
    """Trodden earth with gravel, some weeds."""
    clods, fine = noise(rng, 18.0, octaves=1.4), noise(rng, 3.0)
    clouds = noise(rng, 180.0, octaves=1.3)
    radii = (1.0 + rng.gamma(2.2, 1.1, int(2600 * SIZE_M**2))).astype(np.float32)
    stone, number, rim = stones(rng, np.minimum(radii, 9.0), depth=0.8)
    soil = np.array([0.19, 0.155, 0.115]) * (1.0 + 0.13 * clods + 0.12 * fine + 0.10 * clouds)[..., None]
    pebble = np.array([0.24, 0.225, 0.20]) * (0.55 + 0.9 * number)[..., None] * (1.0 - 0.3 * rim**3)[..., None]
    albedo = np.where((stone > 0.25)[..., None], pebble, soil)
    weeds = np.clip(noise(rng, 22.0) + 0.8 * clouds - 1.9, 0.0, 1.0)[..., None]
    albedo = albedo * (1.0 - weeds) + np.array([0.06, 0.095, 0.035]) * weeds
    height = np.clip(0.35 + 0.10 * clods + 0.03 * fine + 0.35 * np.clip(stone - 0.25, 0, 1), 0.0, 1.0)
    hollow = np.clip((blurred(height, 2.5) - height) * 1.5, 0.0, 0.5)
    albedo = albedo * (1.0 - hollow)[..., None]
    rough = np.full_like(height, 0.93)
    return detail(SIZE_M, float32(albedo), float32(height), float32(rough), float32(-height), 0.010, EARTH_REFLECTANCE)


MAKERS: Final[Mapping[GroundKind, Callable[[np.random.Generator], Detail]]] = {
    GroundKind.ASPHALT: partial(_bound, DENSE),
    GroundKind.CONCRETE: concrete,
    GroundKind.PAVING: paving,
    GroundKind.KERB: kerb,
    GroundKind.GRASS: grass,
    GroundKind.EARTH: earth,
    GroundKind.CHIP_SEAL: partial(_bound, CHIPS),
    GroundKind.SLABS: slabs,
    GroundKind.BLOCKS: blocks,
    GroundKind.TILES: tiles,
    GroundKind.SETTS: setts,
}

_SEED: Final = 1


@cache
def details() -> Mapping[GroundKind, Detail]:
    """The detail textures of all kinds of ground, from the cache; some six seconds of a processor to make them."""
    found = kept("ground", _made)
    names = {kind: _names(kind) for kind in MAKERS}
    return MappingProxyType({kind: Detail(found[m].item(), found[r], found[h]) for kind, (m, r, h) in names.items()})


def _made() -> dict[str, AnyArray]:
    with ThreadPoolExecutor(max_workers=min(len(MAKERS), cpu_count() or 1)) as pool:
        tasks = {kind: pool.submit(make, child(_SEED, Stream.SCENE, int(kind))) for kind, make in MAKERS.items()}
        made = {kind: task.result() for kind, task in tasks.items()}
    give_back()
    columns: dict[str, AnyArray] = {
        name: column
        for kind, each in made.items()
        for name, column in zip(_names(kind), (np.array(each.size_m), each.reflectance, each.relief), strict=True)
    }
    return columns


def _names(kind: GroundKind) -> tuple[str, str, str]:
    return f"{kind.name}-size", f"{kind.name}-reflectance", f"{kind.name}-relief"
