"""A pen that draws in metres of the world frame on a raster image, translucently and without jagged edges."""

from collections.abc import Sequence
from math import ceil, floor

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float64Array

PixelColour = tuple[int, ...]
"""Red, green, blue and, where given, opacity; 0 … 255."""

SMOOTHING = 2
"""Pictures are drawn this many times larger and averaged down."""


class Pen:
    """Draws on an image that is `SMOOTHING` times larger than the finished one; widths are in finished pixels."""

    def __init__(self, image: Image.Image, scale: float, corner_px: tuple[int, int]) -> None:
        """For an RGB image; `scale` and `corner_px` (of its upper left) are those of the finished one."""
        self.image = image
        self.on = ImageDraw.Draw(image, "RGBA")
        self.scale = scale * SMOOTHING
        self.corner = np.array(corner_px, dtype=np.float64) * SMOOTHING

    def at(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) in metres to pixels (..., 2) of the enlarged image."""
        return np.asarray(xy, dtype=np.float64) * (self.scale, -self.scale) - self.corner

    def fill(self, corners: npt.ArrayLike, colour: PixelColour) -> None:
        """A polygon (n, 2)."""
        self.on.polygon(self.at(corners).ravel().tolist(), fill=colour)

    def line(self, points: npt.ArrayLike, colour: PixelColour, width_px: float, *, closed: bool = False) -> None:
        """A line through points (n, 2)."""
        xy = self.at(points)
        if len(xy) > 1:
            xy = np.concatenate([xy, xy[:2]]) if closed else xy
            self.on.line(xy.ravel().tolist(), fill=colour, width=_wide(width_px), joint="curve")

    def disc(
        self,
        centre: npt.ArrayLike,
        radius_px: float,
        fill: PixelColour | None,
        rim: PixelColour | None = None,
        rim_px: float = 1,
    ) -> None:
        """A disc, or a ring where `fill` is None."""
        x, y = self.at(centre)
        reach = radius_px * SMOOTHING
        self.on.ellipse((x - reach, y - reach, x + reach, y + reach), fill=fill, outline=rim, width=_wide(rim_px))

    def area(self, shape: shapely.Geometry, colour: PixelColour) -> None:
        """A geometry of polygons filled; its holes stay open."""
        parts = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and not part.is_empty]
        if not parts:
            return
        corners = self.at(np.reshape(shapely.total_bounds(parts), (2, 2)))
        left, right = _span(corners[:, 0], self.image.width)
        upper, lower = _span(corners[:, 1], self.image.height)
        if left >= right or upper >= lower:
            return
        mask = Image.new("L", (right - left, lower - upper))
        stencil = ImageDraw.Draw(mask)
        opacity = colour[3] if len(colour) > 3 else 255
        for part in sorted(parts, key=lambda part: -float(part.area)):
            for ring, value in ((part.exterior, opacity), *((hole, 0) for hole in part.interiors)):
                xy = self.at(shapely.get_coordinates(ring)) - (left, upper)
                stencil.polygon(xy.ravel().tolist(), fill=value)
        self.image.paste(colour[:3], (left, upper), mask)

    def finished(self) -> Image.Image:
        return self.image.reduce(SMOOTHING)


def _wide(width_px: float) -> int:
    return max(1, round(width_px * SMOOTHING))


def _span(values: Sequence[float] | Float64Array, limit: int) -> tuple[int, int]:
    return max(0, floor(min(values))), min(limit, ceil(max(values)) + 1)
