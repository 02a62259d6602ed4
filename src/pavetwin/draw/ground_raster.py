"""The static world seen from above, as a raster: painted once, in tiles, and cropped per frame.

Pixel grid: x to the east, y to the south, `scale` pixels a metre, pixel (0, 0) at the origin of the world frame.
"""

from collections.abc import Iterator

import numpy as np
import shapely
from matplotlib.colors import LinearSegmentedColormap, to_hex
from PIL import Image, ImageDraw
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import substring

from pavetwin.draw import style
from pavetwin.world.model import CARRIAGEWAY_LANES, Crossing, FurnitureKind, Lane, LaneKind, World

TILE_PX = 512
SMOOTHING = 3
"""Tiles are painted this many times larger and averaged down."""

MARKING_M = 0.15
DASH_M, GAP_M = 3.0, 4.5
STRIPE_M = 0.5
KERB_M = 0.12

ASPHALT = "#D5D4D0"
"""Greyer than the white of the maps, so that markings show."""
MARKING = "#FDFDFB"

TALL_M = 30.0
_HEIGHTS = LinearSegmentedColormap.from_list("heights", [style.BUILDING_LOW, style.BUILDING_HIGH])


class GroundRaster:
    """Paints tiles of a world on demand, and caches them."""

    def __init__(self, world: World, scale: float) -> None:
        self.scale = scale
        painted = [entry for entry in _paint(world) if not entry[0].is_empty]
        self._shapes = [shape for shape, _ in painted]
        self._colours = [colour for _, colour in painted]
        self._tree = shapely.STRtree(self._shapes)
        self._tiles: dict[tuple[int, int], Image.Image] = {}

    def pixel(self, east_m: float, north_m: float) -> tuple[int, int]:
        """The pixel that a place lies in."""
        return round(east_m * self.scale), round(-north_m * self.scale)

    def crop(self, left_px: int, top_px: int, size_px: tuple[int, int]) -> Image.Image:
        """A part of the raster, by its upper left pixel and its width and height."""
        part = Image.new("RGB", size_px)
        width, height = size_px
        for row in range(top_px // TILE_PX, (top_px + height - 1) // TILE_PX + 1):
            for column in range(left_px // TILE_PX, (left_px + width - 1) // TILE_PX + 1):
                part.paste(self._tile(column, row), (column * TILE_PX - left_px, row * TILE_PX - top_px))
        return part

    def _tile(self, column: int, row: int) -> Image.Image:
        if (column, row) not in self._tiles:
            self._tiles[column, row] = self._painted(column, row)
        return self._tiles[column, row]

    def _painted(self, column: int, row: int) -> Image.Image:
        side, scale = TILE_PX * SMOOTHING, self.scale * SMOOTHING
        image = Image.new("RGB", (side, side), style.GROUND)
        draw = ImageDraw.Draw(image, "RGBA")
        reach = TILE_PX / self.scale
        box = shapely.box(column * reach, -(row + 1) * reach, (column + 1) * reach, -row * reach)
        for index in sorted(self._tree.query(box)):
            part = shapely.intersection(self._shapes[index], box.buffer(1.0))
            for polygon in shapely.get_parts(part):
                if not isinstance(polygon, Polygon) or polygon.is_empty:
                    continue
                for ring in _without_holes(polygon):
                    xy = (shapely.get_coordinates(ring) * (scale, -scale)) - (column * side, row * side)
                    draw.polygon(xy.ravel().tolist(), fill=self._colours[index])
        return image.reduce(SMOOTHING)


def _without_holes(polygon: Polygon) -> list[Polygon]:
    """The polygon itself, or parts of it without holes."""
    if not polygon.interiors:
        return [polygon]
    pieces = [polygon]
    for hole in polygon.interiors:
        x = Polygon(hole).representative_point().x
        left, bottom, right, top = polygon.bounds
        halves = (shapely.box(left, bottom, x, top), shapely.box(x, bottom, right, top))
        pieces = [
            part
            for piece in pieces
            for half in halves
            for part in shapely.get_parts(shapely.intersection(piece, half))
            if isinstance(part, Polygon) and not part.is_empty
        ]
    return pieces


def _paint(world: World) -> Iterator[tuple[BaseGeometry, str]]:
    """Shapes and colours, from the ground up."""
    for park in world.parks:
        yield park, style.PARK
    walks = shapely.union_all([_strip(lane) for lane in world.lanes_of(LaneKind.SIDEWALK)])
    walks = shapely.union_all([walks, *(junction.polygon for junction in world.junctions)])
    road = world.carriageway
    yield shapely.union_all([walks, road]).buffer(KERB_M), style.CASING
    yield walks, style.SIDEWALK
    yield road.buffer(KERB_M), style.CASING
    yield road, ASPHALT
    for line in _markings(world):
        yield line.buffer(MARKING_M / 2, cap_style="flat"), MARKING
    for crossing in world.crossings:
        for stripe in _stripes(crossing):
            yield stripe, MARKING
    for building in world.buildings:
        yield building.polygon, style.BUILDING_EDGE
        yield building.polygon.buffer(-0.1), _roof(building.height_m)
    for item in world.furniture:
        if item.kind is FurnitureKind.TREE:
            yield item.position.buffer(item.radius_m), style.TREE + "B0"
        else:
            yield item.position.buffer(max(item.radius_m, 0.15)), style.POLE


def _roof(height_m: float) -> str:
    return to_hex(_HEIGHTS(min(height_m / TALL_M, 1.0)))


def _strip(lane: Lane) -> BaseGeometry:
    return lane.centre_line.buffer(lane.width_m / 2, cap_style="flat")


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


def _stripes(crossing: Crossing) -> Iterator[BaseGeometry]:
    """A zebra crossing: bars in the direction of traffic."""
    corners = shapely.get_coordinates(crossing.polygon.minimum_rotated_rectangle)
    if len(corners) < 4:
        return
    a, b = corners[1] - corners[0], corners[2] - corners[1]
    origin, (walk, bar) = corners[0], (a, b) if np.hypot(*a) >= np.hypot(*b) else (b, a)
    if walk is b:
        origin = corners[1]
    length = float(np.hypot(*walk))
    side = bar if walk is a else corners[0] - corners[1]
    for start in np.arange(STRIPE_M / 2, length - STRIPE_M / 2, 2 * STRIPE_M):
        near, far = origin + walk * (start / length), origin + walk * (min(start + STRIPE_M, length) / length)
        yield shapely.intersection(Polygon([near, far, far + side, near + side]), crossing.polygon)
