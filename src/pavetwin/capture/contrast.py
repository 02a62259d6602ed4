"""How clearly a defect stands out, measured in the picture itself against the same picture of sound pavement.

Widths and depths do not tell: a fine crack shows in low sun and a wide one vanishes in grain. Nor does the picture
alone: a joint, a marking or the edge of a shadow beside a defect is no part of it. What the defect does to the picture,
in units of how much the pavement varies where it lies, and pooled over all of its pixels, is its contrast.
"""

from functools import cached_property

import numpy as np
from scipy import ndimage

from pavetwin.arrays import Float32Array, UInt8Array, UInt32Array
from pavetwin.capture.instance_masks import InstanceMask
from pavetwin.scene.light import LUMINANCE

REACH_PX = 2
"""So far beyond a defect's mask lens, sharpening and motion carry what it does."""

POOLING = 3.0
"""Minkowski exponent of summing over pixels: near the slope of the psychometric function, by which chances of seeing
any one part add up (Quick 1974, A vector-magnitude model of contrast detection; Watson 1979, Probability summation over
time). A sum of squares would let faint haze over a wide area pass for something to be seen."""

_GROUND_PX = 11
"""Side of the square whose mean counts as the ground: what varies less steeply hides nothing."""

_QUARTILES = 1.349
"""Standard deviations between the quartiles of a normal distribution."""

_LEAST_SPREAD = 0.5
"""In grey levels of 255: what rounding leaves of an even surface."""

_LUMA = LUMINANCE.astype(np.float32)


class ContrastMeter:
    """One picture with its instance image; measures the contrast of its defects."""

    def __init__(self, rgb: UInt8Array, defect_free: UInt8Array, labels: UInt32Array) -> None:
        """All of the same height and width; `defect_free` as `Frame.defect_free`."""
        self._rgb, self._sound, self._labels = rgb, defect_free, labels

    def contrast(self, piece: InstanceMask) -> float:
        """Of the piece, in standard deviations of sound pavement."""
        left, top, right, bottom = piece.box
        height, width = self._labels.shape
        rows = slice(max(0, top - REACH_PX), min(height, bottom + REACH_PX))
        columns = slice(max(0, left - REACH_PX), min(width, right + REACH_PX))
        labels = self._labels[rows, columns]
        here = labels == piece.label
        reached = ndimage.maximum_filter(here, 2 * REACH_PX + 1, mode="constant") & ((labels == 0) | here)
        pavement = self._grain[rows, columns][reached]
        # By quartiles, so that a marking or the edge of a shadow that crosses it does not count for unevenness.
        low, high = np.quantile(pavement, (0.25, 0.75))
        done = np.abs(self._done[rows, columns][reached])
        return float(np.sum(done**POOLING) ** (1 / POOLING) / max((high - low) / _QUARTILES, _LEAST_SPREAD))

    @cached_property
    def _even(self) -> Float32Array:
        return np.asarray(self._sound.astype(np.float32) @ _LUMA, dtype=np.float32)

    @cached_property
    def _done(self) -> Float32Array:
        """By how much defects change each pixel."""
        return np.asarray(self._rgb.astype(np.float32) @ _LUMA - self._even, dtype=np.float32)

    @cached_property
    def _grain(self) -> Float32Array:
        """What sound pavement is beyond its own mean around."""
        return np.asarray(self._even - ndimage.uniform_filter(self._even, _GROUND_PX, mode="nearest"), dtype=np.float32)
