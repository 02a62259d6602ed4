"""The grain of bound stones: crushed stones of several sizes in dark mastic, voids where stones have left."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Float32Array
from pavetwin.scene.ground.materials.grain import SIDE_PX, blurred, cells, detail, noise, stones
from pavetwin.scene.model import Detail

SIZE_M: Final = 2.0


SEGREGATION: Final = ((0.022, 0.070), (0.055, 0.095))
"""Wavelengths [m] and standard deviations of the mix's own changes of reflectance. Stones alone average out over a few
centimetres; in photographs of pavements the deviation falls with the scale s as s^-0.35. Ours, after photographs."""


@dataclass(frozen=True)
class StoneMix:
    """Stones and binder of a pavement."""

    stones: tuple[tuple[float, float], ...]
    """Radius [m] and share of the surface for each size."""
    reflectance: float
    """Mean over the surface."""
    depth_m: float
    """From the floor of voids to the tops of stones."""
    mastic: float
    """Reflectance of what is between the stones, where theirs is about 0.15."""
    filmed: float
    """By how much binder darkens the stones that it still covers."""
    hollow: float
    """Contrast of the hollows between stones, which see little of the sky and hold grime."""
    pits_per_m2: float
    """Stones that have left the surface."""


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


def asphalt(rng: np.random.Generator) -> Detail:
    """Aged dense asphalt."""
    return _bound(rng, DENSE)


def chip_seal(rng: np.random.Generator) -> Detail:
    """Chips on sprayed binder."""
    return _bound(rng, CHIPS)


def _bound(rng: np.random.Generator, mix: StoneMix) -> Detail:
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


def _pits(rng: np.random.Generator, per_m2: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Where single stones have left the surface, 0 … 1."""
    count = int(per_m2 * SIZE_M**2)
    radius = (rng.gamma(6.0, 0.55e-3, count) + 1.2e-3) / (SIZE_M / SIDE_PX)
    depth, _, _ = stones(rng, radius.astype(np.float32), depth=0.7)
    return np.clip(blurred(depth, 0.6), 0.0, 1.0) * np.float32(0.85)


def _hold(
    rng: np.random.Generator, level: np.ndarray[tuple[int, ...], np.dtype[np.float32]]
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
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
