"""The demo town, and its houses: closed rows around the blocks of the centre, terraces and single houses further out.

`plan_town` draws the streets, `plan_roads` gives them lanes and names, `place_buildings` lines them with houses. The
town lies north-east of the world's origin. Coordinates of houses are metres in the plan's frame (the main crossing at
the origin). Houses are behind the sidewalks, with or without a front garden, face their street, and do not overlap.
Heights are storeys of about 3 m and a roof: 9 to 15 m in the centre, 6 to 9 m elsewhere, a church with a steeple by a
small square.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, unary_union
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from pavetwin.arrays import Float64Array
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Building, Surface
from pavetwin.world.segments import polygons_of, surface_of
from pavetwin.world.street_graph import Coordinate, turned, unit
from pavetwin.world.town_plan import RADIUS_M, TownPlan, plan_town
from pavetwin.world.town_roads import Rank, RoadPlan, plan_roads, with_parking

CENTRE_RADIUS_M = 145.0
"""Blocks whose middle is nearer to the crossing are built up in closed rows [m]."""
EDGE_RADIUS_M = 262.0
"""Beyond this there are only single farms [m]."""
LEAST_AREA_M2 = 28.0
"""Smaller left-overs are not built [m²]."""
FORECOURT_WIDTH_M, FORECOURT_DEPTH_M = 44.0, 50.0
"""The plot of the church with its square [m]."""


def surfaces(plan: RoadPlan) -> Surface:
    """Everything between the backs of the sidewalks, junction corners rounded as SUMO rounds them."""
    parts = [road.centre_line.buffer(road.half_width_m, quad_segs=4) for road in plan.roads]
    for node, at in plan.nodes.items():
        arms = [road.half_width_m for road in plan.roads if node in (road.start, road.end)]
        parts.append(Point(at).buffer(max(arms) + (1.5 if len(arms) > 2 else 0.0), quad_segs=6))
    return union(parts).buffer(7.5, quad_segs=6).buffer(-7.0, quad_segs=6)


@dataclass(slots=True)
class _Site:
    """The buildings so far, and the area where nothing may be built."""

    forbidden: Surface
    rng: np.random.Generator
    polygons: list[Polygon] = field(default_factory=list)
    heights: list[float] = field(default_factory=list)

    def build(self, polygon: Polygon, height_m: float, *, gap_m: float = 0.0) -> bool:
        """Build unless another building is within the gap on any side."""
        if not polygon.is_valid or polygon.area < LEAST_AREA_M2 or polygon.intersects(self.forbidden):
            return False
        needed = polygon.buffer(gap_m, join_style="mitre") if gap_m else polygon.buffer(-0.02)
        if self.polygons and shapely.intersects(np.array(self.polygons), needed).any():
            return False
        self.polygons.append(polygon)
        self.heights.append(round(height_m, 1))
        return True


def place_buildings(plan: TownPlan, roads: RoadPlan, park: Polygon, seed: int) -> list[Building]:
    """The buildings of a town, in the plan's frame."""
    rng = child(seed, Stream.WORLD, 2_000)
    paved = surfaces(roads)
    site = _Site(union([paved, park.buffer(3)]), rng)
    blocks = _blocks(plan, paved, park)
    deep = [block for block in blocks if block.buffer(-16).area > 60]
    central = [block for block in deep if block.centroid.distance(Point(0, 0)) < CENTRE_RADIUS_M]
    square = _church(site, central)
    for block in deep:
        if block in central or block.distance(Point(0, 0)) < 40:
            _closed_rows(site, block, square, math.inf if block in central else CENTRE_RADIUS_M)
    side_streets = unary_union([road.centre_line for road in roads.roads if road.rank not in (Rank.MAIN, Rank.THROUGH)])
    _line_streets(site, paved, union([*central, square]).buffer(1), side_streets.buffer(22))
    for block in blocks:
        _depths(site, block, square)
    return [
        Building(f"b{number}", polygon, height)
        for number, (polygon, height) in enumerate(zip(site.polygons, site.heights, strict=True))
    ]


def _blocks(plan: TownPlan, paved: Surface, park: Polygon) -> list[Polygon]:
    """The land between streets, block by block, without the park; largest part of each."""
    blocks = []
    for face in plan.graph.faces():
        if face.intersection(park).area > 0.5 * face.area:
            continue
        land = face.difference(paved)
        parts = [part for part in polygons_of(land) if part.area > 300]
        blocks += [orient(Polygon(part.exterior), 1.0) for part in parts]
    return blocks


# --- The centre -------------------------------------------------------------------------------------------------------


def _church(site: _Site, central: Sequence[Polygon]) -> Polygon:
    """A church at the back of a small square, on the straightest front near the crossing; the plot it keeps free."""
    best: tuple[float, Float64Array, Float64Array] | None = None
    for block in central:
        ring = block.exterior
        for along in np.arange(0, ring.length, 6.0):
            middle, ahead = _on_ring(ring, along)
            bend = 1 - float((_tangents_on(ring, along + np.array([-20.0, 20.0])) @ ahead).min())
            inward = turned(ahead, 90)
            plot = _rectangle(middle, ahead, inward, FORECOURT_WIDTH_M, -1.0, FORECOURT_DEPTH_M)
            outside = 1 - float(plot.intersection(block).area) / float(plot.area)
            score = float(np.hypot(*middle)) / 150 + 12 * bend + 8 * outside
            if best is None or score < best[0]:
                best = (score, middle, ahead)
    if best is None:
        return Polygon()
    _, middle, ahead = best
    inward = turned(ahead, 90)

    def local(*points: tuple[float, float]) -> Polygon:
        return Polygon([middle + x * ahead + y * inward for x, y in points])

    nave = local((-6, 18), (6, 18), (6, 30), (11, 30), (11, 37), (6, 37), (6, 41), (2.5, 45), (-2.5, 45), (-6, 41),
                 (-6, 37), (-11, 37), (-11, 30), (-6, 30))  # fmt: skip
    site.build(nave, 12.5)
    site.build(local((-3.2, 11.5), (3.2, 11.5), (3.2, 17.9), (-3.2, 17.9)), 27.0)
    return _rectangle(middle, ahead, inward, FORECOURT_WIDTH_M, -3.0, FORECOURT_DEPTH_M)


def _closed_rows(site: _Site, block: Polygon, square: Polygon, reach_m: float) -> None:
    """A row of houses round a block, wall to wall, with a gap here and there; as far as `reach_m` from the crossing."""
    rng = site.rng
    front = largest(block.buffer(-3.3).buffer(2.5, join_style="mitre"))
    if front.area < 400:
        return
    depth = float(rng.uniform(10.5, 13.0))
    court = front.buffer(-depth, join_style="mitre")
    row = front.difference(court)
    cuts: list[LineString] = [front.exterior, *(part.exterior for part in polygons_of(court))]
    ring = orient(front, 1.0).exterior
    for along in _stations(ring, rng):
        start, ahead = _on_ring(ring, along)
        inward = turned(ahead, 90)
        cuts.append(LineString([start - 0.5 * inward, start + (depth + 1.0) * inward]))
    for part in shapely.polygonize([unary_union(cuts)]).geoms:
        if not row.covers(part.representative_point()) or part.area > 700 or rng.random() < 0.09:
            continue
        shallow = part.difference(front.buffer(-depth + float(rng.choice([0.0, 0.0, 1.2, 2.4])), join_style="mitre"))
        house = largest(shallow)
        if not house.intersects(square) and house.distance(Point(0, 0)) < reach_m:
            storeys = int(rng.choice([3, 3, 4, 4]))
            site.build(
                largest(Polygon(house.exterior).simplify(0.15)), min(15.0, 3.1 * storeys + float(rng.uniform(0.2, 2.4)))
            )


def _stations(ring: LineString, rng: np.random.Generator) -> Iterator[float]:
    """Where party walls stand along a front: every 9 to 16 m, none within 9 m of a corner."""
    every_metre = np.arange(0, ring.length, 1.0)
    before, after = _tangents_on(ring, every_metre - 3), _tangents_on(ring, every_metre + 3)
    corners = every_metre[(before * after).sum(axis=1) < 0.8]
    along, half = 0.0, ring.length / 2
    while along < ring.length - 7:
        if (np.abs((along - corners + half) % ring.length - half) > 9).all():
            yield along
            along += float(rng.uniform(9, 16))
        else:
            along += 1.5


# --- Further out ------------------------------------------------------------------------------------------------------


def _line_streets(site: _Site, paved: Surface, skip: Surface, near_side_street: Surface) -> None:
    """Terraces and single houses along both sides of every street, except `skip`, and few on the roads out of town."""
    rng = site.rng
    shapely.prepare([skip, near_side_street])
    for part in polygons_of(paved):
        for boundary in (orient(part, 1.0).exterior, *orient(part, 1.0).interiors):
            ring = LineString(boundary.coords)
            setback, along = float(rng.uniform(2.5, 5.5)), float(rng.uniform(0, 8))
            while along < ring.length:
                spot, _ = _on_ring(ring, along)
                remote = float(np.hypot(*spot))
                open_land = remote > EDGE_RADIUS_M and not near_side_street.intersects(Point(spot))
                if (open_land and remote > EDGE_RADIUS_M + 50) or skip.intersects(Point(spot)):
                    along += 5.0
                elif open_land and rng.random() < 0.7:
                    along += 22.0
                elif remote < CENTRE_RADIUS_M - 10 and rng.random() < 0.6:
                    along += _terrace(site, ring, along, 1.0, tall=True)
                elif remote < 205 and rng.random() < 0.12:
                    along += _terrace(site, ring, along, setback)
                else:
                    along += _house(site, ring, along, setback + float(rng.uniform(-0.6, 0.8)))


def _terrace(site: _Site, ring: LineString, along: float, setback: float, *, tall: bool = False) -> float:
    """Narrow houses wall to wall on a straight front, `tall` as in the centre; how far to go on along the street."""
    rng = site.rng
    count = int(rng.integers(3, 5) if tall else rng.integers(4, 7))
    width = float(rng.uniform(8.5, 12.0) if tall else rng.uniform(5.6, 6.8))
    depth = float(rng.uniform(9, 11))
    height = float(rng.uniform(9.3, 13.0) if tall else rng.uniform(7.0, 9.0))
    middle, ahead = _on_ring(ring, along + count * width / 2)
    away = turned(ahead, -90)
    bend = float((_tangents_on(ring, along + np.array([2, count * width - 2])) @ ahead).min())
    if bend < (0.965 if tall else 0.985):
        return _house(site, ring, along, setback)
    built = 0
    for k in range(count):
        here = middle + (k - (count - 1) / 2) * width * ahead
        stagger = setback + (0.9 if k % 2 and not tall else 0.0)
        built += site.build(_rectangle(here, ahead, away, width, stagger, stagger + depth), height)
    return count * width + 6.0 if built else 4.0


def _house(site: _Site, ring: LineString, along: float, setback: float) -> float:
    """A single house, often with a wing or a garage; how far to go on along the street."""
    rng = site.rng
    width, depth = float(rng.uniform(8.5, 13.0)), float(rng.uniform(8.0, 11.5))
    middle, ahead = _on_ring(ring, along + width / 2)
    away = turned(ahead, -90)
    if (_tangents_on(ring, along + np.array([0.0, width])) @ ahead).min() < 0.94:
        return 3.0
    body = _rectangle(middle, ahead, away, width, setback, setback + depth)
    side = 1 if rng.random() < 0.5 else -1
    shape = rng.random()
    if shape < 0.3:  # a wing towards the garden
        wing = _rectangle(
            middle + side * width * 0.27 * ahead, ahead, away, width * 0.46, setback + 1, setback + depth + 4.5
        )
        body = largest(unary_union([body, wing]))
    elif shape < 0.5:  # a porch or bay
        bay = _rectangle(middle - side * width * 0.2 * ahead, ahead, away, 3.2, setback - 1.4, setback + 1)
        body = largest(unary_union([body, bay]))
    if not site.build(body, float(rng.uniform(6.0, 9.0)), gap_m=2.6):
        return 3.0
    if rng.random() < 0.35:
        place = middle + side * (width / 2 + 2.0) * ahead
        site.build(_rectangle(place, ahead, away, 3.6, setback + 2.5, setback + 10.5), 3.0)
        return width + 5.0 + float(rng.uniform(1.0, 4.0))
    return width + float(rng.uniform(3.2, 7.5))


def _depths(site: _Site, block: Polygon, square: Polygon) -> None:
    """Workshops in the courts, a hall or school where a block is deep."""
    rng = site.rng
    inner = block.buffer(-20)
    for part in polygons_of(inner):
        if part.area < 150:
            continue
        box = largest(part.minimum_rotated_rectangle)
        (ax, ay), (bx, by) = box.exterior.coords[:2]
        ahead = unit(np.array([bx - ax, by - ay]))
        large = part.area > 1_800 and rng.random() < 0.6
        for _ in range(3 if large else int(part.area // 500) + 1):
            x0, y0, x1, y1 = part.bounds
            spot = np.array([rng.uniform(x0, x1), rng.uniform(y0, y1)])
            length, depth = (
                (rng.uniform(24, 34), rng.uniform(12, 15)) if large else (rng.uniform(7, 15), rng.uniform(5, 8))
            )
            shed = _rectangle(spot, ahead, turned(ahead, 90), float(length), -float(depth) / 2, float(depth) / 2)
            if part.buffer(4).covers(shed) and not shed.intersects(square):
                site.build(shed, float(rng.uniform(7, 9.5) if large else rng.uniform(3.2, 5.5)), gap_m=3.5)


# --- Geometry ---------------------------------------------------------------------------------------------------------


def union(parts: Sequence[Surface]) -> Surface:
    """Their union, of areas only."""
    return surface_of(polygons_of(unary_union(parts)))


def largest(land: BaseGeometry) -> Polygon:
    """The largest polygon of a geometry; an empty one when it has none."""
    return max(polygons_of(land), key=lambda part: float(part.area), default=Polygon())


def _on_ring(ring: LineString, along: float) -> tuple[Float64Array, Float64Array]:
    """Position and unit tangent at a distance along a closed line."""
    at, before, after = _points_on(ring, along + np.array([0.0, -2.0, 2.0]))
    return at, unit(after - before)


def _tangents_on(ring: LineString, along: Float64Array) -> Float64Array:
    """Unit tangents (n, 2) at distances (n,) along a closed line."""
    ahead = _points_on(ring, along + 2.0) - _points_on(ring, along - 2.0)
    return np.asarray(ahead / np.hypot(ahead[:, 0], ahead[:, 1])[:, None])


def _points_on(ring: LineString, along: Float64Array) -> Float64Array:
    """Points (n, 2) at distances (n,) along a closed line."""
    return np.asarray(shapely.get_coordinates(shapely.line_interpolate_point(ring, along % ring.length)))


def _rectangle(
    middle: Float64Array, ahead: Float64Array, away: Float64Array, width: float, near: float, far: float
) -> Polygon:
    """A rectangle astride `middle`, `width` along `ahead`, from `near` to `far` along `away`."""
    a, b = middle - ahead * width / 2, middle + ahead * width / 2
    return Polygon([a + near * away, b + near * away, b + far * away, a + far * away])


SHIFT_M: Coordinate = (RADIUS_M + 10.0, RADIUS_M + 10.0)
"""From the plan's frame, whose origin is the main crossing, to the world frame [m]."""


@dataclass(frozen=True, slots=True)
class Town:
    """A town ready for netconvert; `parks` and `buildings` are in the world frame, `roads` in the plan's."""

    roads: RoadPlan
    parks: tuple[Polygon, ...]
    buildings: tuple[Building, ...]


def build_town(seed: int, parking_m: Mapping[str, float] = MappingProxyType({})) -> Town:
    """The town of a seed; needs no SUMO.

    Args:
        parking_m: width of the wider parking lane of each road that has one: its buildings stand that much further off.
    """
    plan, narrow = _planned(seed)
    roads = with_parking(narrow, parking_m)
    park = largest(plan.park.difference(surfaces(roads)).buffer(-3).buffer(3, join_style="mitre"))
    placed = place_buildings(plan, roads, park, seed)
    buildings = tuple(replace(house, polygon=_moved(house.polygon)) for house in placed)
    return Town(roads, (_moved(park),), buildings)


@lru_cache(maxsize=1)
def _planned(seed: int) -> tuple[TownPlan, RoadPlan]:
    """Plan of a town; used twice while a town is built: without parking lanes and with them."""
    plan = plan_town(seed)
    return plan, plan_roads(plan, seed)


def _moved(polygon: Polygon) -> Polygon:
    """A polygon in the world frame, to the centimetre."""
    shifted = translate(polygon, *SHIFT_M)
    return Polygon([(round(x, 2), round(y, 2)) for x, y in shifted.exterior.coords])
