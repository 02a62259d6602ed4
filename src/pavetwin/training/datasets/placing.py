"""Where an object may stand on a picture of pavement that was taken straight down.

Road is, where no mask says so, all that looks like the pavement around labelled damage, or else like most of the
picture, in colour, lightness and smoothness; how near it must come depends on how much the pavement itself differs
there, so that paving and kerbs in another grey are none. It is not green, not in the black of a bar, and in a part of
the picture that is large; what is far from grey is no pavement. Of several parts those count that show labelled
damage, where there is any. What stands on it already is found by labels; an object without a label is kept off only as
far as it differs from pavement.
"""

from dataclasses import dataclass
from math import hypot
from typing import Any, Final

import cv2
import numpy as np
from scipy import ndimage

from pavetwin.arrays import BoolArray, Float32Array, UInt8Array

AROUND_SHARE: Final = 0.04
"""So far around labelled damage a picture shows its pavement, of its longer side."""

SPREADS: Final = 4.0
"""So many times the median distance that the pavement has to its own middle may road have."""

COLOUR: Final = (2.5, 11.0)
"""Least and greatest such distance in a* and b* of CIE L*a*b*."""

LIGHTNESS: Final = (10.0, 25.0)
"""The same in L*."""

GREY: Final = 14.0
"""Distance in a* and b* to grey, of a colour that pavement may have: asphalt and concrete, also in blue shadow."""

GREEN: Final = 0.06
"""Excess green index beyond which it is vegetation: (2 g − r − b) of shares of red, green and blue (Woebbecke et al.
1995); the limit is our choice."""

DARK: Final = 0.1
"""Of the full scale; what is darker is a bar or a hole."""

ROUGHER: Final = 2.0
"""So many times as rough as the pavement may road be, by its median."""

ROUGH: Final = (0.02, 0.085)
"""Least and greatest such limit: standard deviation of brightness within `ROUGH_SHARE` of the picture's longer side,
of the full scale."""

ROUGH_SHARE: Final = 0.02

WIDEST_GAP: Final = 2.8
"""Of a gap within road that is road too, over `ROUGH_SHARE`: markings and cracks with their edges."""

LEAST_PART: Final = 0.12
"""Of the picture: what is smaller and all around it is not road is none."""

COHERENT: Final = 0.5
"""Coherence of edges, 0 … 1, from which their direction is taken for that of the road."""

KERB_SHARE: Final = 0.05
"""So far beside the road edges tell its direction too, of the picture's longer side."""

STRONGEST: Final = 0.05
"""Share of the edges that tell the direction: those of markings, kerbs and joints."""


def road_mask(picture: UInt8Array, damage: BoolArray | None = None) -> BoolArray:
    """Where a picture (height, width, 3) of pavement shows road; nowhere, where it shows none that is grey.

    Args:
        damage: (height, width) where damage of the pavement is labelled.
    """
    longest = max(picture.shape[:2])
    exact = picture.astype(np.float32) / 255
    side = max(3, round(ROUGH_SHARE * longest))
    smooth = cv2.blur(cv2.cvtColor(exact, cv2.COLOR_RGB2LAB), (side, side))
    shares = cv2.blur(exact / np.maximum(exact.sum(axis=2, keepdims=True), 1e-6), (side, side))
    grey = exact.mean(axis=2)
    spread = np.sqrt(np.maximum(cv2.blur(grey**2, (side, side)) - cv2.blur(grey, (side, side)) ** 2, 0))
    known = damage if damage is not None and damage.any() else None
    sample = _grown(known, round(AROUND_SHARE * longest)) if known is not None else np.ones(grey.shape, dtype=np.bool_)
    lightness, *colour = np.median(smooth[sample], axis=0).tolist()
    if hypot(*colour) > GREY:
        return np.zeros(grey.shape, dtype=np.bool_)
    away = np.linalg.norm(smooth[..., 1:] - np.array(colour), axis=2)
    lighter = np.abs(smooth[..., 0] - lightness)
    road = (
        (away <= np.clip(SPREADS * np.median(away[sample]), *COLOUR))
        & (lighter <= np.clip(SPREADS * np.median(lighter[sample]), *LIGHTNESS))
        & (spread <= np.clip(ROUGHER * np.median(spread[sample]), *ROUGH))
        & (3 * shares[..., 1] - 1 <= GREEN)
        & (cv2.blur(grey, (side, side)) >= DARK)
    )
    # Markings and cracks have rough edges; what is narrow and lies in the road is road.
    by = round(WIDEST_GAP * side / 2)
    closed = ndimage.binary_closing(np.pad(road, 2 * by, mode="edge"), iterations=by)[
        2 * by : -2 * by, 2 * by : -2 * by
    ]
    parts, count = ndimage.label(ndimage.binary_opening(closed, iterations=side))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    sizes[0] = 0
    large = sizes >= LEAST_PART * road.size
    if known is not None:
        large &= np.bincount(parts[known], minlength=count + 1) > 0
    return np.array(np.isin(parts, np.flatnonzero(large)))


def road_direction_deg(picture: UInt8Array, road: BoolArray) -> float | None:
    """The direction of the strongest edges on the road and beside it, to the picture's columns, clockwise, −90 … 90;
    None where they have none (structure tensor)."""
    grey = cv2.GaussianBlur(picture.astype(np.float32).mean(axis=2), (0, 0), 2.0)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    inner = ndimage.binary_erosion(_grown(road, round(KERB_SHARE * max(road.shape))), iterations=4)
    strength: Float32Array = np.hypot(across, down)
    if not inner.any():
        return None
    chosen = inner & (strength >= np.quantile(strength[inner], 1 - STRONGEST))
    twice = np.array(
        [(across[chosen] ** 2 - down[chosen] ** 2).sum(), (2 * across[chosen] * down[chosen]).sum()], dtype=np.float64
    )
    total = float((strength[chosen].astype(np.float64) ** 2).sum())
    if not total or hypot(*twice) / total < COHERENT:
        return None
    # Edges run across their gradient.
    angle = float(np.degrees(np.arctan2(twice[1], twice[0])) / 2 + 90)
    return (angle + 90) % 180 - 90


@dataclass(frozen=True, slots=True)
class Standing:
    """An object's opacity, placed in a picture."""

    left: int
    top: int
    opacity: Float32Array
    """(height, width) 0 … 1."""

    @property
    def window(self) -> Any:
        height, width = self.opacity.shape
        return np.s_[self.top : self.top + height, self.left : self.left + width]


class FreeRoad:
    """The road of a picture, and what is taken of it."""

    def __init__(self, road: BoolArray, taken: BoolArray, gap_px: float) -> None:
        """Args:
        road: (height, width)
        taken: (height, width) where something stands.
        gap_px: that stays free around each object, and to what is not road, between the middles of pixels.
        """
        self._gap = max(2, round(gap_px))
        self._road = road
        self._free = road & ~_grown(taken | ~road, self._gap)

    @property
    def size_px(self) -> tuple[int, int]:
        return self._road.shape[1], self._road.shape[0]

    def place(self, opacity: Float32Array, rng: np.random.Generator, tries: int = 40) -> Standing | None:
        """A place for an object, wholly in the picture, on the road and free; None where none was found."""
        height, width = opacity.shape
        whole_height, whole_width = self._road.shape
        if height >= whole_height or width >= whole_width or not self._free.any():
            return None
        solid = opacity > 0.5
        rows, columns = np.nonzero(self._free)
        for at in rng.integers(len(rows), size=tries).tolist():
            left, top = int(columns[at]) - width // 2, int(rows[at]) - height // 2
            if left < 0 or top < 0 or left + width > whole_width or top + height > whole_height:
                continue
            standing = Standing(left, top, opacity)
            if self._free[standing.window][solid].all():
                return standing
        return None

    def take(self, standing: Standing) -> None:
        """Nothing else may stand there."""
        taken = np.zeros_like(self._free)
        taken[standing.window] = standing.opacity > 0.5
        self._free &= ~_grown(taken, self._gap)


def _grown(mask: BoolArray, by: int) -> BoolArray:
    """A mask and all within a distance in pixels."""
    if not mask.any():
        return mask
    return np.array(ndimage.distance_transform_edt(~mask) <= by)
