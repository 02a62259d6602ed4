"""Ground resolution of a photograph that states none, from the width of the painted lines in it.

A line of markings is 10 to 15 cm wide nearly everywhere. What is brighter than its surroundings, straight, evenly wide
and several times as long as wide is taken for one; its width in pixels is its area over its length. Bars of crossings,
arrows, kerbs and vehicles are left out as far as their shape tells; what is left of them is error.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image

LINE_M: Final = 0.15
"""Width of a painted line: lane lines of towns in China have 0.10 or 0.15 m (GB 51038-2015, 12.3.2). With 0.15 m the
cars in photographs of RDD2022's China drone subset are as long as cars are."""

WIDTH_PX: Final = (5.0, 64.0)
"""Widths that are measured; narrower ones are blurred, wider ones mostly no lines."""
LONG: Final = 5.0
"""Least length of a line, in widths."""
LEAST_LENGTH_PX: Final = 70.0
FILLED: Final = 0.8
"""Least share of its rectangle that a line fills."""
CONTRAST: Final = 14.0
"""By which paint is brighter than its surroundings (L*), or yellower (b*)."""
AROUND_PX: Final = 161
BESIDE: Final = 3.5
"""Distance of parallel bars of a crossing, in widths."""


@dataclass(frozen=True)
class PaintedLine:
    """A line of paint in a picture."""

    middle_px: tuple[float, float]
    direction_rad: float
    width_px: float
    length_px: float
    is_white: bool


def painted_lines(picture: Image.Image) -> list[PaintedLine]:
    """The lines of markings in a picture, without bars that lie side by side."""
    lab = cv2.cvtColor(np.asarray(picture.convert("RGB")), cv2.COLOR_RGB2LAB).astype(np.float32)
    lightness, yellow = lab[..., 0] * (100 / 255), lab[..., 2] - 128
    found = [*_lines(lightness, is_white=True), *_lines(yellow, is_white=False)]
    return [line for line in found if not any(_side_by_side(line, other) for other in found)]


def _lines(field: npt.NDArray[np.float32], *, is_white: bool) -> list[PaintedLine]:
    small = cv2.resize(field, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    middle = cv2.medianBlur(np.clip(small + 64, 0, 255).astype(np.uint8), AROUND_PX // 4 | 1).astype(np.float32) - 64
    around = cv2.resize(middle, field.shape[::-1], interpolation=cv2.INTER_LINEAR)
    rises = field - around
    mask: cv2.typing.MatLike = (rises > CONTRAST).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for outline in outlines:
        line = _line(rises, outline, is_white=is_white)
        if line is not None:
            found.append(line)
    return found


def _line(rises: npt.NDArray[np.float32], outline: cv2.typing.MatLike, *, is_white: bool) -> PaintedLine | None:
    """The line that an outline is of; None unless it is straight, long and evenly wide, and whole across."""
    (x, y), size, degrees = cv2.minAreaRect(outline)
    length, across = max(size) + 1, min(size) + 1
    if length < max(LEAST_LENGTH_PX, LONG * across) or not WIDTH_PX[0] <= across <= 1.3 * WIDTH_PX[1]:
        return None
    direction = np.radians(degrees if size[0] >= size[1] else degrees + 90.0)
    area = cv2.contourArea(outline) + 0.5 * len(outline)
    if area < FILLED * length * across:
        return None
    along = np.array([np.cos(direction), np.sin(direction)])
    width = _width_px(rises, np.array([x, y]), along, length, across)
    if width is None or not WIDTH_PX[0] <= width <= WIDTH_PX[1]:
        return None
    return PaintedLine((x, y), float(direction % np.pi), width, float(length), is_white)


def _width_px(
    rises: npt.NDArray[np.float32], middle: npt.NDArray[np.float64], along: npt.NDArray[np.float64], length: float,
    across: float,
) -> float | None:  # fmt: skip
    """Width at half of the line's rise over both its sides, the median of sections; None where a side is cut off."""
    normal = np.array([-along[1], along[0]])
    offsets = np.arange(-2 * across - 4, 2 * across + 4, 0.25)
    stations = np.linspace(-0.4, 0.4, 33) * length
    points = middle + stations[:, None, None] * along + offsets[None, :, None] * normal
    inside = ((points >= 0) & (points <= np.array(rises.shape[::-1]) - 1)).all(axis=2)
    profile = cv2.remap(
        rises, points[..., 0].astype(np.float32), points[..., 1].astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    near = abs(offsets) < 1.5 * across + 3
    whole = inside[:, near].all(axis=1)
    if whole.sum() < 8:
        return None
    section = np.median(profile[whole], axis=0)
    top = float(np.median(section[abs(offsets) < 0.25 * across]))
    sides = [float(np.median(section[near & (sign * offsets > 0.8 * across)])) for sign in (-1, 1)]
    if top - max(sides) < 0.7 * CONTRAST:
        return None
    edges = 0.0
    for sign, side in zip((-1, 1), sides, strict=True):
        outwards = section[::-1][offsets[::-1] <= 0] if sign < 0 else section[offsets >= 0]
        below = np.flatnonzero(outwards < 0.5 * (top + side))
        if not len(below):
            return None
        edges += 0.25 * (float(below[0]) - 0.5)
    return edges


def _side_by_side(line: PaintedLine, other: PaintedLine) -> bool:
    """Whether two white lines are bars of a crossing or strokes of a sign: parallel, of a width, close together."""
    if other is line or not (line.is_white and other.is_white):
        return False
    turn = abs((line.direction_rad - other.direction_rad + np.pi / 2) % np.pi - np.pi / 2)
    if turn > 0.12 or not 0.6 < line.width_px / other.width_px < 1.6:
        return False
    step = np.subtract(other.middle_px, line.middle_px)
    away = abs(-np.sin(line.direction_rad) * step[0] + np.cos(line.direction_rad) * step[1])
    return bool(0.8 * line.width_px < away < BESIDE * max(line.width_px, other.width_px))


def ground_resolution_m(picture: Image.Image, line_m: float = LINE_M) -> float | None:
    """Metres on the ground that a pixel shows, from the median width of the lines; None without a line."""
    lines = painted_lines(picture)
    return line_m / float(np.median([line.width_px for line in lines])) if lines else None
