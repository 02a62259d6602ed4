"""Painted areas: hatching that traffic keeps off, and crossed lines over junctions that are to be kept clear."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import shapely
from shapely import LineString, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from pavetwin.scene.ground.layout.lines import direction
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.markings.painter import Painter
from pavetwin.scene.ground.styles.marking_standard import BoxJunction, Hatching
from pavetwin.world.model import Junction, Lane, LaneKind

KERB_M: Final = 0.4
"""Hatching keeps this far from a kerb, where gutters and grates are, and from driven lanes."""

PLACE_M: Final = 0.4
CROSSING_M: Final = 1.0
"""And this far from parking places and crossings."""

FREE_M: Final = (2.0, 12.0)  # Shorter ends of parking lanes are not hatched, longer ones are not kept-free corners
WAY_M: Final = 1.6  # Half the width of a way across a junction
NARROWEST_M: Final = 1.4
SMALLEST_M2: Final = 5.0
"""Smaller areas of junctions are not hatched."""

BOX_INSET_M: Final = 0.6  # From the rim of a junction to the lines over it


def corners(plan: SurfaceLayout) -> Iterator[tuple[Polygon, Lane, float]]:
    """Ends of parking lanes without places, each with its lane and its direction [rad]."""
    world = plan.world
    places = [place.polygon.buffer(PLACE_M, join_style="mitre") for place in world.parking]
    crossings = [crossing.polygon.buffer(CROSSING_M, join_style="mitre") for crossing in world.crossings]
    taken, tree = np.array([*places, *crossings], dtype=object), STRtree([*places, *crossings])
    for lane in world.lanes_of(LaneKind.PARKING):
        width = lane.width_m - 2 * KERB_M
        if width < 0.6:
            continue
        strip = lane.centre_line.buffer(width / 2, cap_style="flat")
        free = shapely.difference(strip, shapely.union_all(taken[np.sort(tree.query(strip, "intersects"))]))
        ends = shapely.MultiPoint([lane.centre_line.coords[0], lane.centre_line.coords[-1]])
        for part in shapely.get_parts(free):
            if FREE_M[0] < part.area / width < FREE_M[1] and part.distance(ends) < CROSSING_M + 5.0:
                dx, dy = direction(lane.centre_line, lane.centre_line.project(part.centroid))
                yield part, lane, float(np.arctan2(dy, dx))


def islands(plan: SurfaceLayout, junction: Junction) -> Iterator[tuple[Polygon, float]]:
    """The parts of a junction that no way crosses, each with the direction of its longer side [rad]."""
    box = shapely.box(*junction.polygon.bounds)
    inner = shapely.intersection(junction.polygon, plan.road_near(box.buffer(2.0)).buffer(-KERB_M))
    ways = [LineString(path.line).buffer(WAY_M) for path in plan.paths if path.approach.junction.id == junction.id]
    crossings = [crossing.buffer(CROSSING_M) for crossing in plan.crossings.at(box)]
    free = shapely.difference(inner, shapely.union_all([*ways, *crossings]))
    opened = free.buffer(-NARROWEST_M / 2).buffer(NARROWEST_M / 2 - 0.05, join_style="mitre")
    for part in shapely.get_parts(shapely.simplify(shapely.intersection(opened, free), 0.08)):
        if isinstance(part, Polygon) and part.area > SMALLEST_M2:
            ring = shapely.get_coordinates(part.minimum_rotated_rectangle)
            sides = np.diff(ring[:3], axis=0)
            long = sides[int(np.hypot(*sides.T).argmax())]
            yield part, float(np.arctan2(long[1], long[0]))


def hatch(painter: Painter, area: Polygon, yaw_rad: float, rules: Hatching, wear: float) -> None:
    """Bars across an area within a border line."""
    painter.line(area.exterior, rules.border_m, wear, colour=rules.colour)
    on, off = rules.stripe_m
    for bar in _bands(area, yaw_rad + np.radians(rules.angle_deg), on, on + off):
        painter.outline(shapely.get_coordinates(bar.exterior)[:-1], wear, colour=rules.colour)


def box_lines(painter: Painter, junction: Junction, rules: BoxJunction, wear: float) -> None:
    """Crossed lines over a junction, oblique to its sides, within a border line."""
    inner = junction.polygon.buffer(-BOX_INSET_M, join_style="mitre")
    middle = inner.minimum_rotated_rectangle
    area = max(shapely.get_parts(shapely.intersection(inner, middle)), key=lambda part: part.area)
    if not isinstance(area, Polygon) or area.area < SMALLEST_M2:
        return
    ring = shapely.get_coordinates(middle)
    yaw = float(np.arctan2(*(ring[1] - ring[0])[::-1]))
    painter.line(area.exterior, rules.line_m, wear, colour=rules.colour)
    for turn in (np.pi / 4, -np.pi / 4):
        for band in _bands(area, yaw + turn, rules.line_m, rules.every_m):
            painter.outline(shapely.get_coordinates(band.exterior)[:-1], wear, colour=rules.colour)


def _bands(area: Polygon, yaw_rad: float, wide_m: float, every_m: float) -> Iterator[Polygon]:
    """Parallel strips of an area, along a direction."""
    middle = area.centroid
    turned = shapely.affinity.rotate(area, -yaw_rad, origin=middle, use_radians=True)
    west, south, east, north = turned.bounds
    strips: list[BaseGeometry] = []
    for low in np.arange(south + every_m / 2, north, every_m).tolist():
        strips += shapely.get_parts(shapely.intersection(turned, shapely.box(west, low, east, low + wide_m))).tolist()
    for strip in strips:
        if isinstance(strip, Polygon) and strip.area > 0.02:
            yield shapely.affinity.rotate(strip, yaw_rad, origin=middle, use_radians=True)
