"""Road in pictures of pavement taken straight down: where it is, its direction, free places, and ground resolution.

Without a mask, road is everything that resembles the pavement around labelled damage, or else the larger part of the
picture, in colour, lightness and smoothness. The tolerance follows the variation of the pavement itself, which excludes
paving and kerbs in another grey. Vegetation, black bars and colours far from grey are excluded, and so are small parts.
If some parts show labelled damage, only these count. Objects on the road are known by their labels; an unlabelled
object is avoided only as far as it differs from pavement.

The ground resolution follows from the width of painted lines, which are taken to be `LINE_WIDTH_M` wide. Lines of roads
measure 0.10 to 0.20 m, so an estimate may be wrong by a third. A line is brighter or yellower than its surroundings,
straight, evenly wide, and several times as long as wide. Bars of a crossing are recognised by their neighbours, kerbs
and edges of another surface by the difference between their sides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import hypot, pi
from statistics import median
from typing import Any, Final

import cv2
import numpy as np
from scipy import ndimage

from pavetwin.arrays import BoolArray, Float32Array, Float64Array, UInt8Array

AROUND_SHARE: Final = 0.04  # So far around labelled damage a picture shows its pavement, of its longer side
SPREADS: Final = 4.0  # So many times the median distance that the pavement has to its own middle may road have
COLOUR: Final = (2.5, 11.0)  # Least and greatest such distance in a* and b* of CIE L*a*b*
LIGHTNESS: Final = (10.0, 25.0)  # The same in L*

GREY: Final = 14.0
"""Distance in a* and b* to grey, of a colour that pavement may have: asphalt and concrete, also in blue shadow."""

GREEN: Final = 0.06
"""Excess green index beyond which it is vegetation: (2 g − r − b) of shares of red, green and blue (Woebbecke et al.
1995); the limit is our choice."""

DARK: Final = 0.1  # Brightness below which a pixel belongs to a bar or a hole, share of the full scale
ROUGHER: Final = 2.0  # So many times as rough as the pavement may road be, by its median

ROUGH: Final = (0.02, 0.085)
"""Least and greatest such limit: standard deviation of brightness within `ROUGH_SHARE` of the picture's longer side,
of the full scale."""

ROUGH_SHARE: Final = 0.02

WIDEST_GAP: Final = 2.8
"""Widest gap within the road that counts as road, over `ROUGH_SHARE`: markings and cracks with their edges."""

LEAST_PART: Final = 0.12  # Smallest isolated part that counts as road, share of the picture
COHERENT: Final = 0.5  # Coherence of edges, 0 … 1, from which their direction is taken for that of the road
KERB_SHARE: Final = 0.05  # Strip along the road whose edges also show its direction, share of the picture's longer side
STRONGEST: Final = 0.05  # Share of the edges that determine the direction: those of markings, kerbs and joints


def road_mask(picture: UInt8Array, damage: BoolArray | None = None) -> BoolArray:
    """Mask of the road in a picture (height, width, 3) of pavement; empty if no pavement is grey.

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
    """The direction of the strongest edges on and along the road, to the picture's columns, clockwise, −90 … 90;
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


LINE_WIDTH_M: Final = 0.15
"""Lane lines of towns in China have 0.10 or 0.15 m (GB 51038-2015, 12.3.2). With 0.15 m the cars in photographs of
RDD2022's China drone subset are as long as cars are."""

WIDTH_PX: Final = (4.5, 64.0)  # Widths that are measured: narrower lines are blurred, wider ones mostly no lines

PLAUSIBLE_MM: Final = (2.0, 40.0)

CONTRAST: Final = 9.0  # By which paint is lighter than its surroundings (L*) or yellower (b*)
FAINT: Final = 5.0  # The same of what may be a worn bar of a crossing
SLENDER: Final = 9.0  # Length over width, at least: a dash of two metres has 13, a bar of a crossing mostly less
CUT_OFF: Final = 5.0  # The same of a line that the border of the picture cuts off

REDDISH: Final = 1.5
"""By so much of its redness (a*) paint counts as less light and less yellow (b*): yellow lines have a quarter as much
a* as b*, orange paint of utilities and bricks more than half."""

BAR_LIKE: Final = 3.0  # The same of what may be a bar of a crossing

LEAST_LENGTH_PX: Final = 60.0

FILLED: Final = 0.75  # Share of the smallest rectangle around it that a line fills, at least
WORN: Final = 0.5  # The same of what may be a worn bar of a crossing
ALIKE: Final = 8.0  # Difference of lightness between both sides, at most: a kerb has another surface on one side
ON_ROAD: Final = 0.8  # Share of either side that is road, at least
BARS: Final = 3  # Number of parallel strips within `NEARBY` widths that are the bars of a crossing

NEARBY: Final = 8.0

EDGE: Final = 0.6
"""Share of a white line's rise in L* at its edge. Cameras blur light, and half of the light from road (L* 55) to paint
(90) has L* 76. Of b* it is half."""

_AROUND_PX: Final = 161  # Side of what is around a pixel


@dataclass(frozen=True, slots=True)
class PaintedStrip:
    """A straight strip of paint in a picture: a line, or a bar of a crossing."""

    middle_px: tuple[float, float]
    """Column, row."""
    direction_rad: float
    """From the columns, clockwise, 0 … π."""
    length_px: float
    width_px: float
    contrast: float
    """Difference in lightness (L*) or yellowness (b*) from its surroundings."""
    filled: float
    """Share of the smallest rectangle around it."""
    is_white: bool
    """Else yellow."""
    is_cut_off: bool
    """Whether the image border cuts it off: it may be longer than it looks."""
    is_whole: bool
    """Both of its edges are in the picture, so that its width is measured."""


def marking_gsd_mm(picture: UInt8Array, road: BoolArray | None = None, line_m: float = LINE_WIDTH_M) -> float | None:
    """Millimetres a pixel covers, by the median width of the lines in a picture (height, width, 3); None without any.

    Args:
        road: (height, width) where it shows road; its look decides unless given.
        line_m: width of a line.
    """
    widths = [line.width_px for line in painted_lines(picture, road)]
    gsd_mm = 1000 * line_m / median(widths) if widths else 0.0
    return gsd_mm if PLAUSIBLE_MM[0] <= gsd_mm <= PLAUSIBLE_MM[1] else None


def painted_lines(picture: UInt8Array, road: BoolArray | None = None) -> list[PaintedStrip]:
    """The lines of markings on the road of a picture (height, width, 3), without bars of crossings.

    Args:
        road: (height, width) where it shows road; its look decides unless given.
    """
    lab = cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    lightness, red, yellow = np.moveaxis(cv2.GaussianBlur(lab, (0, 0), 0.8).astype(np.float32), 2, 0)
    reddish = REDDISH * np.maximum(red, 0)
    found = []
    for field, is_white in ((lightness - reddish, True), (yellow - reddish, False)):
        strips = list(_strips(field - _around(field), is_white=is_white))
        found += [each for each in strips if _is_line(each) and not _is_bar(each, strips)]
    if not found:
        return []
    where = road_mask(picture) if road is None else road
    return [line for line in found if _is_on_road(line, lightness, where)]


def _is_line(strip: PaintedStrip) -> bool:
    return (
        strip.contrast >= CONTRAST
        and strip.filled >= FILLED
        and strip.is_whole
        and WIDTH_PX[0] <= strip.width_px <= WIDTH_PX[1]
        and strip.length_px >= max(LEAST_LENGTH_PX, (CUT_OFF if strip.is_cut_off else SLENDER) * strip.width_px)
    )


def _is_bar(line: PaintedStrip, strips: Sequence[PaintedStrip]) -> bool:
    """Return whether a strip is a bar of a crossing: one of several, or next to another and no more slender."""
    parallel = sum(_is_parallel(line, other) for other in strips if other is not line)
    is_slender = line.length_px >= SLENDER * line.width_px
    return parallel >= (BARS - 1 if is_slender or not line.is_white else 1)


def _around(field: Float32Array) -> Float32Array:
    """The median around each pixel, of a picture of quarter size."""
    small = cv2.resize(field, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    # A median of this size takes bytes: half steps from −64 to 63.5 of b*, of L* less 50.
    middle = float(np.median(small))
    coded = np.clip(2 * (small - middle) + 128, 0, 255).astype(np.uint8)
    blurred = cv2.medianBlur(coded, _AROUND_PX // 4 | 1).astype(np.float32)
    return np.asarray(cv2.resize((blurred - 128) / 2 + middle, field.shape[::-1], interpolation=cv2.INTER_LINEAR))


def _strips(rises: Float32Array, *, is_white: bool) -> Iterator[PaintedStrip]:
    """All that is straight, evenly wide, longer than wide and rises above what is around it."""
    parts, _ = ndimage.label(rises > FAINT)
    for number, place in enumerate(ndimage.find_objects(parts), start=1):
        part = parts[place] == number
        if max(part.shape) < 0.5 * LEAST_LENGTH_PX:
            continue
        # What is fainter than half of a line is its blurred edge, or dirt next to it.
        contrast = float(np.quantile(rises[place][part], 0.8))
        part &= rises[place] >= 0.5 * contrast
        mask = cv2.morphologyEx(np.pad(part, 1).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        corner = (place[1].start - 1, place[0].start - 1)
        for outline in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=corner)[0]:
            strip = _strip(rises, outline, contrast, is_white=is_white)
            if strip is not None:
                yield strip


def _strip(rises: Float32Array, outline: cv2.typing.MatLike, contrast: float, *, is_white: bool) -> PaintedStrip | None:
    """The strip that an outline is of; None unless it is straight, long and evenly wide, and whole across."""
    (x, y), size, degrees = cv2.minAreaRect(outline)
    length, across = max(size) + 1, min(size) + 1
    if length < max(0.5 * LEAST_LENGTH_PX, BAR_LIKE * across) or not WIDTH_PX[0] <= across <= 1.3 * WIDTH_PX[1]:
        return None
    filled = (cv2.contourArea(outline) + 0.5 * len(outline)) / (length * across)
    if filled < WORN:
        return None
    direction = np.radians(degrees if size[0] >= size[1] else degrees + 90.0)
    along = np.array([np.cos(direction), np.sin(direction)])
    width = _width_px(rises, np.array([x, y]), along, length, across, contrast, EDGE if is_white else 0.5)
    low, high = outline[:, 0].min(axis=0), outline[:, 0].max(axis=0)
    is_cut_off = bool(low.min() <= 1 or (high >= np.array(rises.shape[::-1]) - 2).any())
    return PaintedStrip(
        middle_px=(x, y),
        direction_rad=float(direction % pi),
        length_px=float(length),
        width_px=float(across) if width is None else width,
        contrast=contrast,
        filled=float(filled),
        is_white=is_white,
        is_cut_off=is_cut_off,
        is_whole=width is not None,
    )


def _width_px(
    rises: Float32Array,
    middle: Float64Array,
    along: Float64Array,
    length: float,
    across: float,
    contrast: float,
    edge: float,
) -> float | None:
    """Width where the median section has the share `edge` of its rise over both sides; None where a side is cut off."""
    normal = np.array([-along[1], along[0]])
    offsets = np.arange(-2 * across - 4, 2 * across + 4, 0.25)
    stations = np.linspace(-0.4, 0.4, 33) * length
    points = (middle + stations[:, None, None] * along + offsets[None, :, None] * normal).astype(np.float32)
    inside = ((points >= 0) & (points <= np.array(rises.shape[::-1]) - 1)).all(axis=2)
    near = abs(offsets) < 1.5 * across + 3
    whole = inside[:, near].all(axis=1)
    if whole.sum() < 8:
        return None
    profile = cv2.remap(rises, points[..., 0], points[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    section = np.median(profile[whole], axis=0)
    top = float(np.median(section[abs(offsets) < 0.25 * across]))
    sides = [float(np.median(section[near & (sign * offsets > 0.8 * across)])) for sign in (-1, 1)]
    if top - max(sides) < 0.5 * contrast:
        return None
    edges = 0.0
    for sign, side in zip((-1, 1), sides, strict=True):
        outwards = slice(None, None, sign)
        away, height = (sign * offsets)[outwards], section[outwards] - side - edge * (top - side)
        below = np.flatnonzero((away > 0) & (height < 0))
        if not len(below):
            return None
        last, first = below[0] - 1, below[0]
        edges += float(np.interp(0.0, [height[first], height[last]], [away[first], away[last]]))
    return edges


def _is_on_road(line: PaintedStrip, lightness: Float32Array, road: BoolArray) -> bool:
    """Return whether both sides of a strip are road of one lightness, or too narrow to decide."""
    along = np.array([np.cos(line.direction_rad), np.sin(line.direction_rad)])
    normal = np.array([-along[1], along[0]])
    steps = np.linspace(-0.45, 0.45, 21)[:, None] * line.length_px * along
    sides, on_road = [], []
    for side in (-1.0, 1.0):
        columns, rows = np.rint(line.middle_px + steps + side * (line.width_px + 2.0) * normal).astype(int).T
        inside = (columns >= 0) & (rows >= 0) & (columns < road.shape[1]) & (rows < road.shape[0])
        if inside.mean() < ON_ROAD:
            return False
        on_road.append(bool(road[rows[inside], columns[inside]].mean() >= ON_ROAD))
        sides.append(float(np.median(lightness[rows[inside], columns[inside]])))
    return (all(on_road) if line.is_white else any(on_road)) and abs(sides[0] - sides[1]) <= ALIKE


def _is_parallel(line: PaintedStrip, other: PaintedStrip) -> bool:
    """Return whether another strip of about the same width runs along it nearby."""
    turn = abs((line.direction_rad - other.direction_rad + pi / 2) % pi - pi / 2)
    if turn > 0.2:
        return False
    apart = np.subtract(other.middle_px, line.middle_px)
    along, across = np.cos(line.direction_rad), np.sin(line.direction_rad)
    sideways = abs(float(-across * apart[0] + along * apart[1]))
    lengthwise = abs(float(along * apart[0] + across * apart[1]))
    return 0.8 * line.width_px < sideways <= NEARBY * line.width_px and lengthwise <= 0.5 * (
        line.length_px + other.length_px
    )
