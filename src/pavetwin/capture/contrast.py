"""How clearly a defect stands out, measured in the image against the same image of defect-free pavement.

Width and depth do not decide it: a fine crack shows in low sun, and a wide one vanishes in coarse texture. The image by
itself does not either: a joint, a marking or a shadow edge beside a defect is not part of it. The contrast is the
change that the defect makes to the image, in units of the variation of the pavement there, pooled over all of its
pixels.
"""

from functools import cached_property

import cv2
import numpy as np

from pavetwin.arrays import BoolArray, Float32Array, UInt8Array, UInt32Array
from pavetwin.capture.instance_masks import InstanceMask
from pavetwin.scene.light import LUMINANCE

REACH_PX = 2
"""The lens, sharpening and motion spread a defect's change this far beyond its mask."""

POOLING = 3.0
"""Minkowski exponent of the sum over pixels: near the slope of the psychometric function, by which the probabilities of
seeing any one part add up (Quick 1974, A vector-magnitude model of contrast detection; Watson 1979, Probability
summation over time). A sum of squares would count faint haze over a wide area as visible."""

_GROUND_PX = 11
"""Side of the window of the local mean: slower variation of the pavement masks no defect."""

_QUARTILES = 1.349
"""Standard deviations between the quartiles of a normal distribution."""

_LEAST_SPREAD = 0.5
"""In grey levels of 255: the variation that rounding leaves on a uniform surface."""

_LUMA = LUMINANCE.astype(np.float32)


class ContrastMeter:
    """Measures the contrast of the defects in one image, from its instance image and its defect-free version."""

    def __init__(self, rgb: UInt8Array, defect_free: UInt8Array, labels: UInt32Array) -> None:
        """All of the same height and width; `defect_free` as `RenderedFrame.defect_free`."""
        self._rgb, self._defect_free, self._labels = rgb, defect_free, labels

    def contrast(self, instance: InstanceMask) -> float:
        """Of an instance, in standard deviations of defect-free pavement."""
        left, top, right, bottom = instance.box
        height, width = self._labels.shape
        rows = slice(max(0, top - REACH_PX), min(height, bottom + REACH_PX))
        columns = slice(max(0, left - REACH_PX), min(width, right + REACH_PX))
        labels = self._labels[rows, columns]
        here = labels == instance.label
        reached = _beside(here) & ((labels == 0) | here)
        pavement = self._grain[rows, columns][reached]
        # By quartiles, so that a marking or shadow edge that crosses the defect does not count as texture.
        low, high = np.quantile(pavement, (0.25, 0.75))
        change = np.abs(self._change[rows, columns][reached])
        return float(np.sum(change**POOLING) ** (1 / POOLING) / max((high - low) / _QUARTILES, _LEAST_SPREAD))

    @cached_property
    def _luma(self) -> Float32Array:
        return np.asarray(self._defect_free.astype(np.float32) @ _LUMA, dtype=np.float32)

    @cached_property
    def _change(self) -> Float32Array:
        """By how much defects change the luma of each pixel."""
        return np.asarray(self._rgb.astype(np.float32) @ _LUMA - self._luma, dtype=np.float32)

    @cached_property
    def _grain(self) -> Float32Array:
        """Luma of the defect-free pavement less its local mean."""
        mean = cv2.blur(self._luma, (_GROUND_PX, _GROUND_PX), borderType=cv2.BORDER_REPLICATE)
        return np.asarray(self._luma - mean, dtype=np.float32)


def _beside(mask: BoolArray) -> BoolArray:
    """The mask and all within a square of `REACH_PX` around it."""
    square = np.ones((2 * REACH_PX + 1, 2 * REACH_PX + 1), dtype=np.uint8)
    return cv2.dilate(mask.astype(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
