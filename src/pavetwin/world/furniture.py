"""Street furniture: from the map, moved behind the kerb, or else placed by rule.

Rules (metres; random choices depend on the seed and the segment alone, not on changes elsewhere):

- *street lights*, 8 high with an arm of 1.5 towards the road, every 30 along every segment, alternating sides, 0.6
  behind the kerb; none within 20 of a mapped one;
- *signals* at every approach that SUMO's traffic light controls: a mast 0.8 behind the kerb, its arm 6 above the lanes;
- *signs*, 2.5 high, 0.5 behind the kerb on the right of every unsignalled approach to a junction of three or more
  streets; none within 15 of a mapped one;
- *trees* along two thirds of the streets with a limit up to 50 km/h, both sides, every 11–16, unless the map has trees
  within 25 of the segment: trunk 0.5 behind the sidewalk, crown radius 2–4 and at most 1 over the carriageway,
  beginning at 2.5–4, up to 6–12 high;
- trees in the parks of an invented town, one for every 180 m², at least 6 apart;
- *poles*, 9 high, every 40 on one side of every third such street, 0.5 behind the kerb, unless mapped ones are near.

Nothing is placed on a road, in a junction, in a building, or within 1.5 of another object (trees: 4 of a light).
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from shapely import Point, Polygon, STRtree

from pavetwin.seeds import Stream, child
from pavetwin.world.buildings import building_distance_m
from pavetwin.world.ground import Nearby, PlacementGround, around, evenly, kerb
from pavetwin.world.model import Building, Furniture, FurnitureKind, LaneKind, Segment
from pavetwin.world.osm import MappedPoint
from pavetwin.world.roadnet import Edge, RoadNet
from pavetwin.world.segments import StreetSurface, direction_at, point_at, segment_key

SIGNAL_HEIGHT_M = 6.0
"""Underside of the arm above the road [m]; 5.5 is the least that is allowed over a road."""

SIGNAL_SETBACK_M, SIGN_SETBACK_M = 0.8, 0.5
LONGEST_ARM_M = 7.0
BACK_FROM_LINE_M = (1.0, 2.0, 3.5, 5.0, 7.0)
"""Distances before the stop line at which a place is tried [m]."""


def signals_of(net: RoadNet, radius_m: float) -> Iterator[list[Furniture]]:
    """Candidate masts of every signalled approach, best first; the arm ends over the last lane's middle."""
    for name, controller in sorted(net.signalled.items()):
        edge = net.edges[name]
        if not edge.for_cars or not edge.carriageway:
            continue
        last = max((n for n, lane in enumerate(edge.carriageway) if lane.kind is not LaneKind.PARKING), default=0)
        lanes = edge.carriageway[: last + 1]
        arm = SIGNAL_SETBACK_M + sum(lane.width_m for lane in lanes) - lanes[-1].width_m / 2
        mast = Furniture("", FurnitureKind.SIGNAL, Point(0, 0), SIGNAL_HEIGHT_M, radius_m, controller=controller)
        yield [
            replace(mast, position=at, yaw_rad=yaw, arm_m=round(min(arm, LONGEST_ARM_M), 2))
            for at, yaw in _places(edge, SIGNAL_SETBACK_M, net.left_hand)
        ]


def signs_of(
    net: RoadNet, streets: Sequence[StreetSurface], height_m: float, radius_m: float
) -> Iterator[list[Furniture]]:
    """Places of the sign at every unsignalled approach to a junction of three or more streets, best first."""
    arms: dict[str, int] = {}
    for street in streets:
        for end in {street.street.start, street.street.end}:
            arms[end] = arms.get(end, 0) + 1
    for street in streets:
        for edge in street.edges:
            if edge.id not in net.signalled and arms.get(edge.end, 0) >= 3:
                sign = Furniture("", FurnitureKind.SIGN, Point(0, 0), height_m, radius_m)
                yield [
                    replace(sign, position=at, yaw_rad=yaw) for at, yaw in _places(edge, SIGN_SETBACK_M, net.left_hand)
                ]


def _places(edge: Edge, setback_m: float, left_hand: bool) -> Iterator[tuple[Point, float]]:
    """Points behind the kerb near the end of an edge, and the direction from there over the road (yaw, radians)."""
    lane = edge.carriageway[0]
    side = 1.0 if left_hand else -1.0
    for back in BACK_FROM_LINE_M:
        station = max(0.0, lane.length_m - back)
        x, y = point_at(lane.centre_line, station)
        dx, dy = direction_at(lane.centre_line, station)
        out = (-dy * side, dx * side)
        reach = lane.width_m / 2 + setback_m
        yield Point(x + out[0] * reach, y + out[1] * reach), math.atan2(-out[1], -out[0])


LIGHT_SPACING_M, LIGHT_HEIGHT_M, LIGHT_ARM_M, LIGHT_SETBACK_M = 30.0, 8.0, 1.5, 0.6
POLE_SPACING_M, POLE_HEIGHT_M, POLE_SETBACK_M = 40.0, 9.0, 0.5
SIGN_HEIGHT_M = 2.5
TREE_SPACING_M, TREE_OVERHANG_M = (11.0, 16.0), 1.0
PARK_AREA_A_TREE_M2 = 180.0
CROWN_RADIUS_M, CROWN_BASE_M, TREE_HEIGHT_M = (2.0, 4.0), (2.5, 4.0), (6.0, 12.0)
MAPPED_NEAR_M = 25.0
"""No trees (or poles) are added by rule to a segment with mapped ones this near [m]."""

CALM_STREET_MPS = 14.0
"""Trees and poles stand along streets with at most this limit: 50 km/h [m/s]."""

RADIUS_M = {
    FurnitureKind.STREET_LIGHT: 0.10,
    FurnitureKind.POLE: 0.12,
    FurnitureKind.SIGN: 0.05,
    FurnitureKind.SIGNAL: 0.12,
}
"""Radius of a mast [m]."""

LARGEST_MOVE_M = {FurnitureKind.SIGN: 12.0}
"""Largest move of a mapped object off the road [m]; signs are mapped on the middle of the street. Others: 4."""

KEY = 0
"""This file's child of the furniture stream."""


@dataclass(slots=True)
class Placed:
    """Furniture so far, and how much of each kind came from the map."""

    ground: PlacementGround
    buildings: Nearby[Polygon]
    things: list[Furniture] = field(default_factory=list)
    mapped: Counter[FurnitureKind] = field(default_factory=Counter)
    _near: Nearby[Furniture] = field(default_factory=lambda: Nearby(16.0))
    _mapped_trees: dict[FurnitureKind, STRtree] | None = None

    def add(self, thing: Furniture, *, apart_m: float = 1.5, clearance_m: float = 0.4) -> bool:
        """Place an object where it is free; `numbered` sets the id."""
        at = thing.position
        if self.is_near(at, apart_m) or self.ground.road_distance_m(at) < clearance_m:
            return False
        if building_distance_m(at, self.buildings, 0.3) < 0.3:
            return False
        self.things.append(thing)
        self._near.add((at.x, at.y, at.x, at.y), thing)
        return True

    def is_near(self, at: Point, within_m: float, kind: FurnitureKind | None = None) -> bool:
        """Whether an object (of a kind) is within a distance."""
        close = self._near.query(around(at.x, at.y, within_m))
        return any(kind in (None, thing.kind) and thing.position.distance(at) < within_m for thing in close)

    def mapped_near(self, kind: FurnitureKind, segment: Segment) -> bool:
        """Whether the map has an object of a kind within `MAPPED_NEAR_M` of a segment; only after `_place_mapped`."""
        if self._mapped_trees is None:
            mapped = self.things[: self.mapped.total()]
            self._mapped_trees = {
                each: STRtree([thing.position for thing in mapped if thing.kind is each]) for each in FurnitureKind
            }
        return len(self._mapped_trees[kind].query(segment.centre_line, "dwithin", distance=MAPPED_NEAR_M)) > 0

    def numbered(self) -> tuple[Furniture, ...]:
        """All furniture by kind in the order of placing, with ids such as `tree0001`."""
        counts: Counter[FurnitureKind] = Counter()
        result = []
        for thing in sorted(self.things, key=lambda thing: thing.kind.value):
            counts[thing.kind] += 1
            result.append(replace(thing, id=f"{thing.kind.value}{counts[thing.kind]:04d}"))
        return tuple(result)


def furnish(
    net: RoadNet,
    streets: Sequence[StreetSurface],
    segments: Sequence[Segment],
    ground: PlacementGround,
    buildings: Iterable[Building],
    points: Iterable[MappedPoint],
    parks: Iterable[Polygon],
    seed: int,
) -> tuple[tuple[Furniture, ...], Counter[FurnitureKind]]:
    """All furniture of a world, and how many of each kind came from the map; the rest was placed by rule.

    `points` are the map's own, `parks` those to be planted with trees.
    """
    houses: Nearby[Polygon] = Nearby(40.0)
    for building in buildings:
        houses.add(building.polygon.bounds, building.polygon)
    placed = Placed(ground, houses)
    _place_mapped(placed, points, child(seed, Stream.FURNITURE, KEY))
    for signal in signals_of(net, RADIUS_M[FurnitureKind.SIGNAL]):
        _first_free(placed, signal)
    for candidates in signs_of(net, streets, SIGN_HEIGHT_M, RADIUS_M[FurnitureKind.SIGN]):
        if not placed.is_near(candidates[0].position, 15.0, FurnitureKind.SIGN):
            _first_free(placed, candidates)
    for segment in segments:
        _place_lights(placed, segment, child(seed, Stream.FURNITURE, KEY, segment_key(segment), 0))
    calm = {edge.id for edge in net.edges.values() if edge.speed_limit_mps <= CALM_STREET_MPS}
    keys = {edge.id: street.street.key for street in streets for edge in street.edges}
    for segment in segments:
        if calm.issuperset(segment.edges):
            street_rng = child(seed, Stream.FURNITURE, KEY, keys[segment.edges[0]], 1)
            _place_green(placed, segment, street_rng, child(seed, Stream.FURNITURE, KEY, segment_key(segment), 1))
    for index, park in enumerate(parks):
        _plant(placed, park, child(seed, Stream.FURNITURE, KEY, index, 2))
    return placed.numbered(), placed.mapped


def _first_free(placed: Placed, candidates: Iterable[Furniture]) -> None:
    any(placed.add(candidate) for candidate in candidates)


def _place_mapped(placed: Placed, points: Iterable[MappedPoint], rng: np.random.Generator) -> None:
    for point in points:
        draw = rng.random(3)
        clearance = 0.5 if point.kind is FurnitureKind.TREE else LIGHT_SETBACK_M
        at = placed.ground.beside_road(point.position, clearance, LARGEST_MOVE_M.get(point.kind, 4.0))
        if at is None:
            continue
        if point.kind is FurnitureKind.TREE:
            thing = _tree(placed, at, draw, point.radius_m, point.height_m)
        else:
            thing = _mast(placed, at, point)
        if thing is not None and placed.add(thing, apart_m=0.5):
            placed.mapped[point.kind] += 1


def _mast(placed: Placed, at: Point, point: MappedPoint) -> Furniture:
    usual = {FurnitureKind.STREET_LIGHT: LIGHT_HEIGHT_M, FurnitureKind.POLE: POLE_HEIGHT_M}.get(
        point.kind, SIGN_HEIGHT_M
    )
    height = min(20.0, max(2.0, point.height_m or usual))
    mast = Furniture("", point.kind, at, height, RADIUS_M[point.kind])
    roads = placed.ground.roads_near(at, 12.0)
    if point.kind is not FurnitureKind.STREET_LIGHT or not roads:
        return mast
    nearest = min(roads, key=at.distance)
    foot = nearest.boundary.interpolate(nearest.boundary.project(at))
    return replace(mast, yaw_rad=math.atan2(foot.y - at.y, foot.x - at.x), arm_m=LIGHT_ARM_M)


def _tree(
    placed: Placed,
    at: Point,
    draw: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]],
    crown_m: float | None = None,
    height_m: float | None = None,
) -> Furniture | None:
    """A tree of drawn size (three numbers of 0 … 1); None without room for its crown next to a house."""

    def between(limits: tuple[float, float], share: float) -> float:
        return limits[0] + (limits[1] - limits[0]) * float(share)

    room = placed.ground.road_distance_m(at) + TREE_OVERHANG_M
    to_house_m = building_distance_m(at, placed.buildings, 8.0) + 0.5
    crown = min(crown_m or between(CROWN_RADIUS_M, draw[0]), room, to_house_m, 8.0)
    if crown < 1.0:
        return None
    height = min(35.0, max(3.0, height_m or between(TREE_HEIGHT_M, draw[1])))
    base = min(between(CROWN_BASE_M, draw[2]), height * 0.5)
    return Furniture("", FurnitureKind.TREE, at, round(height, 2), round(crown, 2), clear_height_m=round(base, 2))


def _place_lights(placed: Placed, segment: Segment, rng: np.random.Generator) -> None:
    first = 1 if rng.random() < 0.5 else -1
    for index, station in enumerate(evenly(segment.length_m, LIGHT_SPACING_M)):
        side = first * (-1) ** index
        for shift, where in ((0.0, side), (3.0, side), (-3.0, side), (0.0, -side)):
            at, out = _behind_kerb(segment, station + shift, where, LIGHT_SETBACK_M)
            if placed.is_near(at, 20.0, FurnitureKind.STREET_LIGHT):
                break
            yaw = math.atan2(-out[1], -out[0])
            light = Furniture("", FurnitureKind.STREET_LIGHT, at, LIGHT_HEIGHT_M, RADIUS_M[FurnitureKind.STREET_LIGHT])
            if placed.add(replace(light, yaw_rad=yaw, arm_m=LIGHT_ARM_M)):
                break


def _place_green(placed: Placed, segment: Segment, street_rng: np.random.Generator, rng: np.random.Generator) -> None:
    """Trees, or a line of poles, along a calm street; `street_rng` decides for the whole street."""
    lined, with_poles, pole_side = street_rng.random() < 0.65, street_rng.random() < 0.35, street_rng.random() < 0.5
    if lined and not placed.mapped_near(FurnitureKind.TREE, segment):
        setback = max(1.2, placed.ground.sidewalk_width_m(segment.edges) + 0.5)
        for side in (1, -1):
            station = float(rng.uniform(3.0, 9.0))
            while station < segment.length_m - 3.0:
                draw, present = rng.random(3), rng.random() < 0.85
                at, _ = _behind_kerb(segment, station, side, setback + float(rng.uniform(0.0, 0.5)))
                station += float(rng.uniform(*TREE_SPACING_M))
                if present and not placed.is_near(at, 4.0):
                    tree = _tree(placed, at, draw)
                    if tree is not None and tree.radius_m >= 1.5:
                        placed.add(tree, apart_m=4.0)
    if with_poles and not placed.mapped_near(FurnitureKind.POLE, segment):
        for station in evenly(segment.length_m, POLE_SPACING_M):
            at, _ = _behind_kerb(segment, station, 1 if pole_side else -1, POLE_SETBACK_M)
            placed.add(Furniture("", FurnitureKind.POLE, at, POLE_HEIGHT_M, RADIUS_M[FurnitureKind.POLE]), apart_m=2.5)


def _plant(placed: Placed, park: Polygon, rng: np.random.Generator) -> None:
    low_x, low_y, high_x, high_y = park.bounds
    inner = park.buffer(-2.0)
    for _ in range(int(park.area / PARK_AREA_A_TREE_M2) * 2):
        share, draw = rng.random(2), rng.random(3)
        at = Point(low_x + share[0] * (high_x - low_x), low_y + share[1] * (high_y - low_y))
        if inner.contains(at):
            tree = _tree(placed, at, draw)
            if tree is not None:
                placed.add(tree, apart_m=6.0)


def _behind_kerb(segment: Segment, station_m: float, side: int, setback_m: float) -> tuple[Point, tuple[float, float]]:
    at, out = kerb(segment, min(max(station_m, 0.0), segment.length_m), side)
    return Point(at.x + out[0] * setback_m, at.y + out[1] * setback_m), out
