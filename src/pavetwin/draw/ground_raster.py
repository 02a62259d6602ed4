"""The static world seen from above, as a raster painted once in tiles, and the pen that paints it in metres."""

from collections.abc import Iterator, Sequence
from functools import cache
from math import ceil, floor

import numpy as np
import numpy.typing as npt
import shapely
from PIL import Image, ImageDraw
from shapely import LineString
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from pavetwin.arrays import Float64Array
from pavetwin.draw import shapes, style
from pavetwin.draw.extent import sidewalks
from pavetwin.draw.mission_style import rgb
from pavetwin.draw.world_map import TALL_M
from pavetwin.world.model import CARRIAGEWAY_LANES, FurnitureKind, World

PixelColour = tuple[int, ...]  # Red, green, blue and, where given, opacity; 0 … 255
SMOOTHING = 2
"""Images are drawn this many times larger and averaged down."""


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


TILE_PX = 512
MARKING_M = 0.15
DASH_M, GAP_M = 3.0, 4.5
STRIPE_M = 0.5
KERB_M = 0.12

ASPHALT = "#D5D4D0"
"""Greyer than the white of the maps, so that markings show."""
MARKING = "#FDFDFB"


class GroundRaster:
    """Paints tiles of a world on demand, and caches them."""

    def __init__(self, world: World, scale: float) -> None:
        self.scale = scale
        painted = [entry for entry in _paint(world) if not entry[0].is_empty]
        self._shapes = [shape for shape, _ in painted]
        self._colours = [colour for _, colour in painted]
        self._tree = shapely.STRtree(self._shapes)
        self._tile = cache(self._painted)

    def pixel(self, east_m: float, north_m: float) -> tuple[int, int]:
        """The pixel that a place lies in."""
        return round(east_m * self.scale), round(-north_m * self.scale)

    def crop(self, left_px: int, top_px: int, size_px: tuple[int, int]) -> Image.Image:
        """A part of the raster, by its upper left pixel and its width and height."""
        part, (width, height) = Image.new("RGB", size_px), size_px
        for row in range(top_px // TILE_PX, (top_px + height - 1) // TILE_PX + 1):
            for column in range(left_px // TILE_PX, (left_px + width - 1) // TILE_PX + 1):
                part.paste(self._tile(column, row), (column * TILE_PX - left_px, row * TILE_PX - top_px))
        return part

    def _painted(self, column: int, row: int) -> Image.Image:
        side = TILE_PX * SMOOTHING
        pen = Pen(Image.new("RGB", (side, side), style.GROUND), self.scale, (column * TILE_PX, row * TILE_PX))
        reach = TILE_PX / self.scale
        box = shapely.box(column * reach, -(row + 1) * reach, (column + 1) * reach, -row * reach)
        for index in sorted(self._tree.query(box)):
            pen.area(shapely.intersection(self._shapes[index], box.buffer(1.0)), self._colours[index])
        return pen.finished()


def _paint(world: World) -> Iterator[tuple[BaseGeometry, PixelColour]]:
    """Shapes and colours, from the ground up."""
    for park in world.parks:
        yield park, rgb(style.PARK)
    walks, road = sidewalks(world), world.carriageway
    yield shapely.union_all([walks, road]).buffer(KERB_M), rgb(style.CASING)
    yield walks, rgb(style.SIDEWALK)
    yield road.buffer(KERB_M), rgb(style.CASING)
    yield road, rgb(ASPHALT)
    for line in _markings(world):
        yield line.buffer(MARKING_M / 2, cap_style="flat"), rgb(MARKING)
    for crossing in world.crossings:
        for bar in shapes.stripes(crossing.polygon, STRIPE_M, STRIPE_M):
            yield LineString(bar).buffer(STRIPE_M / 2, cap_style="flat"), rgb(MARKING)
    for building in world.buildings:
        yield building.polygon, rgb(style.BUILDING_EDGE)
        roof = shapes.mix(style.BUILDING_LOW, style.BUILDING_HIGH, min(building.height_m / TALL_M, 1.0))
        yield building.polygon.buffer(-0.1), rgb(roof)
    for item in world.furniture:
        if item.kind is FurnitureKind.TREE:
            yield item.position.buffer(item.radius_m), (*rgb(style.TREE), 176)
        else:
            yield item.position.buffer(max(item.radius_m, 0.15)), rgb(style.POLE)


def _markings(world: World) -> Iterator[BaseGeometry]:
    """Dashes between the lanes of one direction, an unbroken line between the directions."""
    two_way = {edge for street in world.streets if len(street.edges) > 1 for edge in street.edges}
    for edge in dict.fromkeys(lane.edge for lane in world.lanes):
        lanes = world.lanes_on(edge, *CARRIAGEWAY_LANES)
        for lane in lanes[:-1]:
            yield from _dashes(world.beside(lane, lane.width_m / 2))
        if edge in two_way and lanes:
            yield world.beside(lanes[-1], lanes[-1].width_m / 2)


def _dashes(line: BaseGeometry) -> Iterator[BaseGeometry]:
    if not isinstance(line, LineString) or line.length < DASH_M:
        return
    for start in np.arange(GAP_M / 2, line.length - DASH_M / 2, DASH_M + GAP_M):
        yield substring(line, float(start), float(start) + DASH_M)
