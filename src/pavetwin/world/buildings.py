"""Buildings: from the map, cut back from the roads; or, for a source without any, placed along the streets by rule.

Rule: both sides of every segment are lined with houses of 9–24 m frontage and 9–16 m depth, set back 3–6 m from the
sidewalk, 0.5–3 m apart (some 4–10 m), of 2–6 storeys of 3 m, within one storey of the segment's mean;
every fourth is L-shaped. None is nearer than 3 m to a sidewalk or in a park.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from shapely import Point, Polygon

from pavetwin.seeds import Stream, child
from pavetwin.world.ground import Nearby, PlacementGround, around, kerb
from pavetwin.world.model import Building, Segment
from pavetwin.world.segments import polygons_of, segment_key, union_of

ROAD_CLEARANCE_M = 0.2
"""A mapped building is cut back to this distance from the road [m]."""

KEPT_SHARE = 0.3
"""A mapped building of which less than this is off the road is dropped; so is one below 6 m²."""

SMALLEST_M2 = 6.0
STOREY_M = 3.0
KEY = 1
"""This file's child of the furniture stream."""


def clear_of_roads(footprints: Iterable[tuple[Polygon, float]], ground: PlacementGround) -> tuple[Building, ...]:
    """Buildings `b0001` … from footprints and heights [m], cut back where they stand on a road (such as an arch)."""
    buildings: list[Building] = []
    for polygon, height in footprints:
        rest = polygon
        near = ground.roads_near(polygon, ROAD_CLEARANCE_M)
        if near:
            left = polygons_of(polygon.difference(union_of(near, ROAD_CLEARANCE_M)))
            if not left or left[0].area < max(SMALLEST_M2, KEPT_SHARE * polygon.area):
                continue
            rest = left[0]
        buildings.append(Building(f"b{len(buildings) + 1:04d}", rest, height))
    return tuple(buildings)


def buildings_by_rule(
    segments: Sequence[Segment], ground: PlacementGround, parks: Sequence[Polygon], seed: int
) -> tuple[Building, ...]:
    """Houses along every segment by the rule above; the same seed gives the same houses."""
    street = _Street(ground, parks)
    for segment in segments:
        rng = child(seed, Stream.FURNITURE, KEY, segment_key(segment))
        for side in (1, -1):
            street.line(segment, side, rng)
    return tuple(street.buildings)


class _Street:
    def __init__(self, ground: PlacementGround, parks: Sequence[Polygon]) -> None:
        self._ground = ground
        self._taken: Nearby[Polygon] = Nearby(40.0)
        for park in parks:
            self._taken.add(park.bounds, park)
        self.buildings: list[Building] = []

    def line(self, segment: Segment, side: int, rng: np.random.Generator) -> None:
        """One side of one segment."""
        sidewalk = self._ground.sidewalk_width_m(segment.edges)
        usual_storeys = int(rng.integers(2, 7))
        usual_setback = float(rng.uniform(3.5, 5.5))
        station = float(rng.uniform(1.0, 6.0))
        while station < segment.length_m - 6.0:
            frontage = float(rng.uniform(9.0, 24.0))
            depth = float(rng.uniform(9.0, 16.0))
            setback = sidewalk + min(6.0, max(3.0, usual_setback + float(rng.normal(0.0, 0.4))))
            storeys = min(6, max(2, usual_storeys + int(rng.integers(-1, 2))))
            height = round(STOREY_M * storeys + float(rng.uniform(0.0, 0.9)) * (storeys < 6), 2)
            notch = (float(rng.uniform(0.35, 0.6)), float(rng.uniform(0.3, 0.5))) if rng.random() < 0.25 else None
            gap = float(rng.uniform(0.5, 3.0) if rng.random() < 0.7 else rng.uniform(4.0, 10.0))
            for shrink in (1.0, 0.7, 0.5):
                house = _house(segment, side, station, frontage * shrink, depth * shrink, setback, notch)
                if self._fits(house, sidewalk + 3.0):
                    self._taken.add(house.bounds, house)
                    self.buildings.append(Building(f"b{len(self.buildings) + 1:04d}", house, height))
                    station += frontage * shrink + gap
                    break
            else:
                station += 5.0

    def _fits(self, house: Polygon, clearance_m: float) -> bool:
        if not house.is_valid or self._ground.roads_near(house, clearance_m - 0.05):
            return False
        low_x, low_y, high_x, high_y = house.bounds
        near = self._taken.query((low_x - 0.5, low_y - 0.5, high_x + 0.5, high_y + 0.5))
        return all(house.distance(other) >= 0.4 for other in near)


def _house(
    segment: Segment,
    side: int,
    station_m: float,
    frontage_m: float,
    depth_m: float,
    setback_m: float,
    notch: tuple[float, float] | None,
) -> Polygon:
    """A footprint square to the street at its middle; `notch` is the share of frontage and depth cut off behind."""
    middle = min(segment.length_m, station_m + frontage_m / 2)
    at, out = kerb(segment, middle, side)
    along = (out[1] * side, -out[0] * side)

    def corner(forward: float, outward: float) -> tuple[float, float]:
        return at.x + along[0] * forward + out[0] * outward, at.y + along[1] * forward + out[1] * outward

    half, front, back = frontage_m / 2, setback_m, setback_m + depth_m
    ring = [corner(-half, front), corner(half, front)]
    if notch is None:
        ring += [corner(half, back), corner(-half, back)]
    else:
        inner = half - notch[0] * frontage_m
        shallow = back - notch[1] * depth_m
        ring += [corner(half, shallow), corner(inner, shallow), corner(inner, back), corner(-half, back)]
    return Polygon(ring)


def building_distance_m(point: Point, buildings: Nearby[Polygon], within_m: float) -> float:
    """Distance to the nearest building, infinite when none is within `within_m`."""
    near = buildings.query(around(point.x, point.y, within_m))
    return min((float(polygon.distance(point)) for polygon in near), default=math.inf)
