"""Detail textures of sidewalks: bricks, tiles and setts, with the sand in their joints."""

from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array, FloatArray, Int64Array
from pavetwin.scene.ground.materials.grain import SIDE_PX, blurred, detail, float32, noise, stones
from pavetwin.scene.model import Detail

BLOCK_M: Final = 0.10
"""Width of a paving block of 200 × 100 mm (EN 1338 and EN 1344), twice as long as wide."""

BLOCKS: Final = 16
"""Widths of blocks over the texture: herringbone repeats every four."""

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
    size_m = TILE_M * TILES
    rows, columns = _places(rng, 0.2)
    pitch = SIDE_PX / TILES
    x, y = columns / pitch, rows / pitch
    i, j = np.floor(x).astype(int) % TILES, np.floor(y).astype(int) % TILES
    border_m = _border(x % 1.0, y % 1.0, 1, 1) * TILE_M
    each = rng.standard_normal((TILES, TILES))[j, i]
    shade = 0.6 * each - 4.0 * (j % 4 == 0)
    groove = np.clip(1.0 - np.abs((y * GROOVES) % 1.0 - 0.5) * TILE_M / GROOVES / 0.004, 0.0, 1.0)
    level = rng.standard_normal((TILES, TILES))[j, i]
    return _laid(
        rng, size_m, border_m, shade, level, joint_m=0.005, contrast=0.09, mean=TILE_REFLECTANCE, groove=groove
    )


def setts(rng: np.random.Generator) -> Detail:
    """Split granite setts in courses across the street, with rounded heads and wide joints."""
    size_m = SETT_M * SETTS
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
    return _laid(
        rng, size_m, border_m, shade, level, joint_m=0.012, contrast=0.13, mean=SETT_REFLECTANCE, dome=0.3 * dome
    )


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
