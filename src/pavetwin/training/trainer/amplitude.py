"""Fourier amplitude transfer (Yang and Soatto 2020, "FDA: Fourier Domain Adaptation for Semantic Segmentation").

The low frequencies of a synthetic image get the amplitudes of a photograph: its colours, its light, how these vary over
the image. Phases stay, and with them where things are, so that labels stay true.

The low frequencies are few, so they are computed by two small matrix products instead of a transform of all. Amplitudes
are kept per pixel and at whole cycles an image: those of a photograph hold for a part of another image of any size.
"""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pavetwin.arrays import Float64Array, UInt8Array

Complex = NDArray[np.complex128]

_LEAST_PX: Final = 8
"""Of the shorter side of what is changed: less has no frequencies of its own."""


def half_block(size_px: tuple[int, int], beta: float) -> int:
    """Cycles an image up to which amplitudes are exchanged: β times the shorter side, rounded down as published."""
    return int(beta * min(size_px))


def low_frequencies(pixels: NDArray[Any], most: int) -> Complex:
    """(2 · most + 1, 2 · most + 1, channels) Fourier coefficients a pixel at −most … most cycles down and across.

    Args:
        pixels: (height, width, channels).
        most: at most half of the shorter side.
    """
    height, width = pixels.shape[:2]
    down, across = _waves(most, height), _waves(most, width)
    found = np.einsum("ur,rvc->uvc", down, np.einsum("rkc,vk->rvc", pixels, across, optimize=True), optimize=True)
    return np.asarray(found / (height * width), dtype=np.complex128)


def _waves(most: int, length: int) -> Complex:
    """(2 · most + 1, length) e^(−2πi · cycles · place / length)."""
    cycles = np.arange(-most, most + 1)[:, None]
    return np.asarray(np.exp(-2j * np.pi * cycles * np.arange(length) / length), dtype=np.complex128)


def with_amplitudes(pixels: UInt8Array, amplitudes: Float64Array, beta: float) -> UInt8Array:
    """The image with a photograph's amplitudes at low frequencies, clipped to 0 … 255.

    Args:
        pixels: (height, width, 3).
        amplitudes: (2 · n + 1, 2 · n + 1, 3) of the photograph: the magnitudes of its `low_frequencies`. Above n
            cycles nothing is exchanged.
        beta: β.
    """
    changed = exchanged(pixels, amplitudes, beta)
    return np.asarray(np.clip(np.round(changed), 0, 255), dtype=np.uint8)


def exchanged(pixels: UInt8Array, amplitudes: Float64Array, beta: float) -> Float64Array:
    """The same before it is rounded and clipped: (height, width, 3)."""
    height, width = pixels.shape[:2]
    known = amplitudes.shape[0] // 2
    if min(height, width) < _LEAST_PX:
        return pixels.astype(np.float64)
    most = min(half_block((height, width), beta), known, (min(height, width) - 1) // 2)
    own = low_frequencies(pixels, most)
    inner = slice(known - most, known + most + 1)
    # Only the difference is transformed back: what does not change is not touched by rounding.
    size = np.abs(own)
    phase = np.divide(own, size, out=np.ones_like(own), where=size > 0)
    difference = (amplitudes[inner, inner] - size) * phase
    down, across = _waves(most, height).conj(), _waves(most, width).conj()
    moved = np.einsum("ur,uvc->rvc", down, difference, optimize=True)
    return np.asarray(pixels + np.einsum("rvc,vk->rkc", moved, across, optimize=True).real, dtype=np.float64)
