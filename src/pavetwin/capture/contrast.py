"""How clearly a defect stands out from the pavement close around it, measured in the picture itself.

Widths and depths do not tell: a fine crack shows in low sun and a wide one vanishes in grain. So the picture is asked.
Luma less the mean of a square around each pixel leaves what is small; of that, what the darkest pixels of the defect
have more than the pavement beside it, in units of how much the pavement itself varies, is the contrast.
"""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pavetwin.capture.pieces import Piece
from pavetwin.scene.model import defect_label

GUARD_PX, RING_PX = 2, 7
"""The pavement that a defect is compared with: from the first to the second distance around it."""

LEAST_RING_PX = 20
"""With fewer pixels of pavement beside it, nothing is measured."""

_LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""ITU-R BT.709, of values as the eye and the file have them."""

_GRAIN_PX = 3
"""Side of the square whose mean stands for a pixel: less of the road's grain, and a crack is still one."""

_QUARTILES = 1.349
"""Standard deviations between the quartiles of a normal distribution."""

_LEAST_SPREAD = 0.5
"""In grey levels of 255: what rounding leaves of an even surface."""

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Look:
    """What a class of defects looks like, and from which contrast on it is seen."""

    ground_px: int
    """Side of the square whose mean counts as the ground; odd."""
    share: float
    """Of its pixels, the darkest, that tell it: how much of its mask is crack or rim."""
    bright_too: bool
    """Whether it may as well be brighter: a pothole in the sun."""
    least: float
    """A fainter one is not labelled. Grain alone has 1.3 at a share of 0.1, and 2.1 at one of 0.02."""


class Picture:
    """One picture with its instance image; measures the contrast of its defects."""

    def __init__(self, rgb: npt.NDArray[np.uint8], labels: npt.NDArray[np.uint32]) -> None:
        """Both of the same height and width."""
        self._rgb, self._labels = rgb, labels
        self._relief = cache(self._relief_of)

    def contrast(self, piece: Piece, look: Look) -> float | None:
        """In standard deviations of the pavement around the piece; None where too little of that is in the picture."""
        left, top, right, bottom = piece.box
        height, width = self._labels.shape
        rows = slice(max(0, top - RING_PX), min(height, bottom + RING_PX))
        columns = slice(max(0, left - RING_PX), min(width, right + RING_PX))
        labels, relief = self._labels[rows, columns], self._relief(look.ground_px)[rows, columns]
        here = labels == piece.label
        near, far = (ndimage.maximum_filter(here, 2 * reach + 1, mode="constant") for reach in (GUARD_PX, RING_PX))
        beside = relief[far & ~near & (labels == 0)]
        if len(beside) < LEAST_RING_PX:
            return None
        # By quartiles, so that a marking or the edge of a shadow on one side does not count for unevenness.
        low, middle, high = np.quantile(beside, (0.25, 0.5, 0.75))
        bright, dark = np.quantile(relief[here], (look.share, 1.0 - look.share))
        differs = max(dark - middle, middle - bright) if look.bright_too else dark - middle
        return float(differs / max((high - low) / _QUARTILES, _LEAST_SPREAD))

    @cached_property
    def _luma(self) -> Floats:
        return np.asarray(self._rgb.astype(np.float32) @ _LUMA, dtype=np.float32)

    @cached_property
    def _smooth(self) -> Floats:
        return _mean(self._luma, _GRAIN_PX)

    def _relief_of(self, ground_px: int) -> Floats:
        """How much darker than the ground around it each pixel is, in grey levels; agents are no ground."""
        is_agent = (self._labels > 0) & (self._labels < defect_label(0))
        if not is_agent.any():
            return _mean(self._luma, ground_px) - self._smooth
        ground = np.where(is_agent, np.float32(0.0), self._luma)
        share = np.maximum(_mean(1.0 - is_agent.astype(np.float32), ground_px), np.float32(1e-3))
        return np.asarray(_mean(ground, ground_px) / share - self._smooth, dtype=np.float32)


def _mean(values: Floats, side_px: int) -> Floats:
    return np.asarray(ndimage.uniform_filter(values, side_px, mode="nearest"), dtype=np.float32)
