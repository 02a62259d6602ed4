"""Texture sampling as on a GPU: mip pyramids, wrapped or clamped, with trilinear filtering."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from pavetwin._core import texture_sample
from pavetwin.arrays import Float32Array, FloatArray

LEVEL_SLOPE: Final = 4.0
"""Two mip levels are blended over this share (1/4) of the interval between them, around its middle."""


def linear_of_srgb(coded: npt.ArrayLike) -> Float32Array:
    """Linear values of sRGB-coded ones, both 0 … 1 (IEC 61966-2-1)."""
    value = np.asarray(coded, dtype=np.float32)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


def srgb_of_linear(linear: npt.ArrayLike) -> Float32Array:
    """sRGB-coded values of linear ones, both 0 … 1 (IEC 61966-2-1)."""
    value = np.clip(np.asarray(linear, dtype=np.float32), 0.0, 1.0)
    return np.where(value <= 0.0031308, value * 12.92, 1.055 * value ** (1 / 2.4) - 0.055).astype(np.float32)


def smoothstep(low: npt.ArrayLike, high: npt.ArrayLike, value: npt.ArrayLike) -> Float32Array:
    """0 below `low`, 1 above `high`, smooth between (the shading languages' function of that name)."""
    low, high = np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32)
    share = np.clip((np.asarray(value, dtype=np.float32) - low) / (high - low), 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share), dtype=np.float32)


@dataclass(frozen=True)
class Pyramid:
    """A texture's mip pyramid, each level (k, k, c) float32, row 0 at v = 0."""

    levels: tuple[Float32Array, ...]
    wraps: bool
    """Whether it repeats; otherwise it is clamped to its edge texels."""

    @classmethod
    def of(cls, texture: Float32Array, *, wraps: bool) -> "Pyramid":
        """A square texture of 2ⁿ texels with all its levels."""
        levels = [np.ascontiguousarray(texture, dtype=np.float32)]
        while len(levels[-1]) > 1:
            fine = levels[-1]
            coarse = fine.reshape(len(fine) // 2, 2, fine.shape[1] // 2, 2, -1).mean(axis=(1, 3))
            levels.append(coarse.astype(np.float32))
        return cls(tuple(levels), wraps)

    def sample(self, uv: FloatArray, footprint: float | FloatArray) -> Float32Array:
        """Values (..., c) at `uv` (..., 2), 0 … 1 over the texture.

        Args:
            uv: texture coordinates; texel centres lie at (i + ½) / k.
            footprint: side of a pixel's footprint in texture coordinates, one number or (...).
        """
        size = len(self.levels[0])
        level = np.log2(np.maximum(np.asarray(footprint, dtype=np.float32) * np.float32(size), np.float32(1)))
        whole = np.floor(level)
        level = whole + np.clip((level - whole - 0.5) * LEVEL_SLOPE + 0.5, 0, 1)
        level = np.ascontiguousarray(np.broadcast_to(level, uv.shape[:-1]), dtype=np.float32).reshape(-1)
        places = np.ascontiguousarray(uv, dtype=np.float64).reshape(-1, 2)
        found = texture_sample(list(self.levels), places, level, self.wraps)
        return found.reshape(*uv.shape[:-1], found.shape[-1])
