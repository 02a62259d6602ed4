"""How photographs look in numbers: colours, noise, sharpness; and a synthetic image moved to such numbers.

Sharpness and noise are read from the power spectrum of the luma, averaged over blocks (Welch's method). White noise has
the same power at all frequencies, and a blur leaves nothing else at the highest ones. So the power there, in the blocks
that have least of it, is taken for noise. Sharpness is the power at high frequencies over that at middle ones, both
without the noise: a change of contrast does not move it, and a blur lowers it by a known factor at each frequency.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from PIL import Image, ImageFilter

from pavetwin.arrays import BoolArray, Float64Array, UInt8Array

COLOURS: Final = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]])
"""Luma and two differences of colour, of red, green and blue (ITU-R BT.601), in which colours are matched as by
Reinhard et al. (2001): scaled each by itself, red, green and blue would give grey things colours."""

LUMA: Final = COLOURS[0]

BLOCK_PX: Final = 32
"""Side of the blocks whose spectra are averaged."""

HIGH: Final = (0.25, 0.4)
"""Cycles a pixel: details of two to four pixels."""
MIDDLE: Final = (0.08, 0.15)
"""Details of seven to twelve pixels."""
HIGHEST: Final = 0.45
"""From here on the power is taken for noise."""

QUIET: Final = 0.1
"""Quantile of the blocks by which noise is told: those with little texture."""

MOST_BLUR_PX: Final = 3.0
"""Standard deviation of the greatest blur."""

MOST_GAIN: Final = 2.0
"""The greatest change of contrast, up or down: more would show rounding as steps."""

_QUIET_SHARE: Final = 0.83
"""Of the power of white noise that the quantile of its blocks has; measured on images of 320 and 512 px."""

_TINY: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Appearance:
    """Of one picture."""

    mean: Float64Array
    """(3,) of luma and two differences of colour, for levels of 0 … 255."""
    spread: Float64Array
    """(3,) standard deviations."""
    noise: float
    """Standard deviation of the luma's noise, in levels of 255."""
    sharpness: float
    """Power of high over that of middle frequencies; NaN where the picture has no details, or is too small to tell."""


def appearance_of(pixels: UInt8Array) -> Appearance:
    """Measured on (height, width, 3)."""
    noise, power = _noise_and_power(pixels)
    flat = pixels.reshape(-1, 3) @ COLOURS.T
    return Appearance(flat.mean(axis=0), flat.std(axis=0), noise, _sharpness(power, 0.0))


def moved_to(pixels: UInt8Array, goal: Appearance, rng: np.random.Generator) -> UInt8Array:
    """The picture blurred to the goal's sharpness, its luma and colours scaled and shifted, and noise added.

    Details and noise that it has are not taken away: it is never sharpened, and noise is added up to the goal's.
    """
    _, power = _noise_and_power(pixels)
    sigma = blur_between(power, goal.sharpness)
    shown = pixels
    if sigma > 0:
        # Mirrored beyond the edges by Pillow's own filter; its radius is the standard deviation.
        shown = np.asarray(Image.fromarray(pixels).filter(ImageFilter.GaussianBlur(sigma)))
    colours = shown @ COLOURS.T
    mean, spread = colours.mean(axis=(0, 1)), colours.std(axis=(0, 1))
    gain = np.clip(goal.spread / np.maximum(spread, _TINY), 1 / MOST_GAIN, MOST_GAIN)
    moved = ((colours - mean) * gain + goal.mean) @ np.linalg.inv(COLOURS).T
    has, _ = _noise_and_power(_levels(moved))
    missing = np.sqrt(max(0.0, goal.noise**2 - has**2))
    return _levels(moved + missing * rng.standard_normal(moved.shape[:2])[..., None])


def blur_between(power: Float64Array, sharpness: float) -> float:
    """Standard deviation in pixels of the Gaussian blur after which a picture has a sharpness; 0 if it has less.

    Args:
        power: of its luma without noise, by `_FREQUENCY`. A blur multiplies it by e^(−(2πσf)²).
    """
    now = _sharpness(power, 0.0)
    if np.isnan(now) or np.isnan(sharpness) or now <= sharpness:
        return 0.0
    low, high = 0.0, MOST_BLUR_PX
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if _sharpness(power, middle) > sharpness else (low, middle)
    return (low + high) / 2


def _sharpness(power: Float64Array, sigma: float) -> float:
    left = power * np.exp(-((2 * np.pi * sigma * _FREQUENCY) ** 2))
    middle = left[_within(MIDDLE)].mean()
    return float(left[_within(HIGH)].mean() / middle) if middle > _TINY else float("nan")


def _frequencies() -> Float64Array:
    down = np.fft.fftfreq(BLOCK_PX)[:, None]
    return np.hypot(down, np.fft.rfftfreq(BLOCK_PX)[None])


_FREQUENCY: Final = _frequencies()
"""(rows, columns) cycles a pixel of a block's half spectrum."""

_WINDOW: Final = np.outer(np.hanning(BLOCK_PX), np.hanning(BLOCK_PX))


def _within(band: tuple[float, float]) -> BoolArray:
    low, high = band
    return (low <= _FREQUENCY) & (high > _FREQUENCY)


def _noise_and_power(pixels: UInt8Array) -> tuple[float, Float64Array]:
    """Standard deviation of the noise, and the mean power of the blocks without it, as variances a frequency."""
    luma = pixels @ LUMA
    rows, columns = (side // BLOCK_PX for side in luma.shape)
    if not rows or not columns:
        return 0.0, np.zeros_like(_FREQUENCY)
    blocks = luma[: rows * BLOCK_PX, : columns * BLOCK_PX].reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
    blocks = blocks.reshape(-1, BLOCK_PX, BLOCK_PX)
    waves = np.fft.rfft2((blocks - blocks.mean(axis=(1, 2), keepdims=True)) * _WINDOW)
    power = np.abs(waves) ** 2 / (_WINDOW**2).sum()
    noise = float(np.quantile(power[:, _FREQUENCY >= HIGHEST].mean(axis=1), QUIET)) / _QUIET_SHARE
    return float(np.sqrt(noise)), np.maximum(power.mean(axis=0) - noise, 0.0)


def _levels(values: Float64Array) -> UInt8Array:
    return np.asarray(np.clip(np.round(values), 0, 255), dtype=np.uint8)
