"""Colours and type of the animation, in addition to those of every figure."""

from functools import cache
from typing import Any, Final

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.typing import ColorType
from PIL import ImageDraw, ImageFont

from pavetwin.draw.fonts import runs, usual_file
from pavetwin.draw.style import VISIBILITY

Rgb = tuple[int, int, int]

UAV: Final = "#14181C"
SEEN: Final = "#BFD9EA"
"""Pavement that was seen by some capture."""
HIDDEN: Final = "#3A2E3F"
"""Pavement in the window that an agent hides."""
OPEN_DEFECT: Final = "#D55E00"

AGENT_COLOURS: Final = {
    "car": "#66788A",
    "van": "#9AA5AE",
    "truck": "#8C7361",
    "bus": "#BF9F55",
    "motorcycle": "#434B54",
    "pedestrian": "#20262B",
    "aircraft": "#7A2E8E",
    "parked": "#B4B7BB",
}
"""Keyed by group; muted, so that the colours of visibility stand out."""

SMALLEST_VEHICLE_M = 1.2
"""Agents that are shorter and do not walk are other aircraft."""


def agent_group(length_m: float, height_m: float, pedestrian: bool) -> str:
    """The key of `AGENT_COLOURS` for an agent, found by its size, as user-defined kinds have other names."""
    if pedestrian:
        return "pedestrian"
    if length_m < SMALLEST_VEHICLE_M:
        return "aircraft"
    if length_m < 3.0:
        return "motorcycle"
    if length_m >= 10.5 and height_m < 3.6:
        return "bus"
    if length_m >= 5.5 and height_m > 2.2:
        return "truck"
    return "van" if height_m > 1.9 else "car"


def visibility_rgb(visibility: float) -> Rgb:
    """The colour of o ∈ [0, 1] in hundredths, eight bits a channel."""
    red, green, blue, _ = VISIBILITY(float(np.clip(np.round(visibility, 2), 0.0, 1.0)))
    return round(255 * red), round(255 * green), round(255 * blue)


def rgb(colour: ColorType) -> Rgb:
    """A colour as eight bits a channel."""
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue


@cache
def font(size_px: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The typeface of all images, at a size in pixels."""
    return ImageFont.truetype(usual_file(bold=bold), size_px)


def write(
    pen: ImageDraw.ImageDraw, place_px: tuple[float, float], text: str, size_px: int, *, bold: bool = False, **how: Any
) -> float:
    """Write a text in the fonts that it needs; `how` goes to Pillow. Returns the x at which it ends."""
    x, y = place_px
    for run, file in runs(text, bold=bold):
        face = ImageFont.truetype(file, size_px)
        pen.text((x, y), run, font=face, **how)
        x += face.getlength(run)
    return x
