"""The grain of concrete, paving slabs and kerb stones."""

from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.ground.materials.grain import SIDE_PX, blurred, detail, float32, noise, stones
from pavetwin.scene.model import Detail

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
    rows, columns = np.meshgrid(np.arange(SIDE_PX), np.arange(SIDE_PX), indexing="ij")
    del rows
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
