"""The grain of what grows or lies loose: grass and earth."""

from typing import Final

import numpy as np

from pavetwin.scene.ground.materials.grain import SIDE_PX, blurred, detail, float32, noise, stones
from pavetwin.scene.model import Detail

SIZE_M: Final = 2.0
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
