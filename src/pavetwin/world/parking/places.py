"""Parking places of a world: row by row along its kerbs, by the map's tags and areas or else by the rule, except at
junctions, traffic lights, crossings, driveways, bus stops, hydrants and masts.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, STRtree
from shapely.affinity import translate

from pavetwin.arrays import Float64Array
from pavetwin.world.ground import Nearby
from pavetwin.world.model import Building, Furniture, FurnitureKind, Segment, World
from pavetwin.world.parking.kerbs import (
    SHORTEST_M,
    Kerb,
    KerbInterval,
    Stretch,
    WayIndex,
    depth_m,
    kerbs_of,
    lane_depth_m,
    slots_in,
    spacing_for,
)
from pavetwin.world.parking.mapped import (
    NO_PLACES,
    UNMAPPED,
    MappedArea,
    Obstacle,
    ObstacleKind,
    ParkingMap,
    Provision,
    SideParking,
)
from pavetwin.world.parking.place import ParkingPlace, ParkingSource, StreetSide
from pavetwin.world.parking.rule import Clearances, ParkingRule
from pavetwin.world.roadnet import RoadNet
from pavetwin.world.segments import StreetSurface, direction_at

CONTINUES_RAD = math.radians(35.0)
"""A street that leaves a junction in line with another to within this is its continuation and no corner."""

CHORD_M = 4.0
"""Distance over which a kerb's curvature is measured, in both directions [m]."""

STRIP_M = 8.0
"""A bus stop, a mast or a driveway belongs to a kerb up to this far from it [m]."""


class ClearKerbs:
    """Computes the free intervals of kerbs."""

    def __init__(
        self,
        net: RoadNet,
        streets: Sequence[StreetSurface],
        mapped: ParkingMap,
        furniture: Iterable[Furniture],
        clear: Clearances,
    ) -> None:
        self._clear = clear
        self._signalled = net.signalled
        self._centres = {junction.id: junction.polygon.centroid for junction in net.junctions}
        self._arms: dict[str, list[StreetSurface]] = {}
        for street in streets:
            for junction in (street.street.start, street.street.end):
                self._arms.setdefault(junction, []).append(street)
        self._obstacles = mapped.obstacles
        self._obstacle_tree = STRtree([obstacle.position for obstacle in mapped.obstacles])
        self._zebras = [] if mapped.ways else [each.polygon for each in net.crossings if not each.signalled]
        self._zebra_tree = STRtree(self._zebras)
        self._mouths = mapped.mouths
        self._mouth_tree = STRtree(mapped.mouths)
        self._masts = list(furniture)
        self._mast_tree = STRtree([thing.position for thing in self._masts])

    def free(self, kerb: Kerb, reach_m: tuple[float, float]) -> list[KerbInterval]:
        """The stations at which places that cover `reach_m` (from, to; outwards from the kerb) may lie."""
        blocked = [*self._at_junctions(kerb), *self._at_obstacles(kerb), *self._at_mouths(kerb)]
        blocked += [*self._before_zebras(kerb), *self._in_curves(kerb), *self._at_masts(kerb, reach_m)]
        if self._signalled.get(kerb.edge) is not None:
            blocked.append((kerb.length_m - self._clear.signal_m, kerb.length_m))
        return without((0.0, kerb.length_m), blocked)

    def _at_junctions(self, kerb: Kerb) -> Iterator[KerbInterval]:
        street = kerb.street.street
        for junction, at_start in ((street.start, True), (street.end, False)):
            centre = self._centres.get(junction)
            if centre is None:
                continue
            leaving = _leaving(kerb.street, at_start)
            for arm in self._arms[junction]:
                if arm is kerb.street:
                    continue
                arm_leaving = _leaving(arm, arm.street.start == junction)
                if abs(math.remainder(arm_leaving - leaving - math.pi, math.tau)) < CONTINUES_RAD:
                    continue
                half = float(arm.polygon.area) / arm.length_m / 2 + self._clear.junction_m
                end = arm.centre_line.coords[0 if arm.street.start == junction else -1]
                yield from kerb.stations_within(LineString([end, (centre.x, centre.y)]).buffer(half, cap_style="flat"))
                yield from kerb.stations_within(arm.centre_line.buffer(half, cap_style="flat"))

    def _in_curves(self, kerb: Kerb) -> Iterator[KerbInterval]:
        radius = self._clear.curve_radius_m
        stations = np.arange(CHORD_M, kerb.length_m - CHORD_M, 1.0)
        if not radius or not len(stations):
            return
        behind, here, ahead = (
            shapely.get_coordinates(shapely.line_interpolate_point(kerb.line, stations + shift))
            for shift in (-CHORD_M, 0.0, CHORD_M)
        )
        first, second = here - behind, ahead - here
        across = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        turned = np.abs(np.arctan2(across, (first * second).sum(axis=1)))
        for station in stations[turned * radius > CHORD_M]:
            yield float(station) - CHORD_M / 2, float(station) + CHORD_M / 2

    def _at_obstacles(self, kerb: Kerb) -> Iterator[KerbInterval]:
        near = self._obstacle_tree.query(kerb.line, predicate="dwithin", distance=kerb.width_m + STRIP_M)
        for index in sorted(near):
            yield from self._of_obstacle(kerb, self._obstacles[int(index)])

    def _of_obstacle(self, kerb: Kerb, obstacle: Obstacle) -> Iterator[KerbInterval]:
        at, clear = obstacle.position, self._clear
        station = float(kerb.line.project(at))
        beside = kerb.line.distance(at)
        match obstacle.kind:
            case ObstacleKind.CROSSING | ObstacleKind.MARKED_CROSSING:
                if beside <= kerb.width_m / 2 + 3.0 and kerb.street.polygon.distance(at) < 1.0:
                    before = clear.marked_crossing_m if obstacle.kind is ObstacleKind.MARKED_CROSSING else 0.0
                    half = clear.crossing_half_width_m
                    yield station - half - before, station + half
            case ObstacleKind.BUS_STOP:
                if beside <= STRIP_M and (_is_outside(kerb, station, at) or beside < kerb.width_m / 4):
                    yield station - clear.bus_stop_m, station + clear.bus_stop_m
            case ObstacleKind.HYDRANT:
                if beside <= STRIP_M / 2 and clear.hydrant_m > 0:
                    yield station - clear.hydrant_m, station + clear.hydrant_m

    def _before_zebras(self, kerb: Kerb) -> Iterator[KerbInterval]:
        """Clearance before the crossing at the end of a kerb, which counts as a zebra where it is not mapped."""
        end, clear_m = Point(kerb.line.coords[-1]), self._clear.marked_crossing_m
        for index in self._zebra_tree.query(end, predicate="dwithin", distance=clear_m):
            yield kerb.length_m - clear_m + self._zebras[int(index)].distance(end), kerb.length_m

    def _at_mouths(self, kerb: Kerb) -> Iterator[KerbInterval]:
        for index in sorted(self._mouth_tree.query(kerb.line, predicate="intersects")):
            for point in shapely.get_parts(kerb.line.intersection(self._mouths[int(index)])):
                station = float(kerb.line.project(point))
                yield station - self._clear.driveway_m, station + self._clear.driveway_m

    def _at_masts(self, kerb: Kerb, reach_m: tuple[float, float]) -> Iterator[KerbInterval]:
        furthest = max(abs(reach) for reach in reach_m)
        for index in sorted(self._mast_tree.query(kerb.line, predicate="dwithin", distance=furthest + 1.0)):
            mast = self._masts[int(index)]
            radius = (0.25 if mast.kind is FurnitureKind.TREE else mast.radius_m) + self._clear.mast_m
            station = float(kerb.line.project(mast.position))
            apart = kerb.line.distance(mast.position)
            outwards = apart if _is_outside(kerb, station, mast.position) else -apart
            if reach_m[0] - radius < outwards < reach_m[1] + radius:
                yield station - radius, station + radius


def without(whole: KerbInterval, blocked: Iterable[KerbInterval]) -> list[KerbInterval]:
    """An interval less others; pieces too short for a vehicle are dropped."""
    free: list[KerbInterval] = []
    at = whole[0]
    for start, end in sorted(blocked):
        if start > at:
            free.append((at, min(start, whole[1])))
        at = max(at, end)
    free.append((at, whole[1]))
    return [(start, end) for start, end in free if end - start >= SHORTEST_M]


def _leaving(street: StreetSurface, at_start: bool) -> float:
    """Direction in which a street leaves one of its junctions."""
    dx, dy = direction_at(street.centre_line, 0.0 if at_start else street.length_m, over_m=8.0)
    return math.atan2(dy, dx) if at_start else math.atan2(-dy, -dx)


def _is_outside(kerb: Kerb, station_m: float, at: Point) -> bool:
    """Whether a point is on the side of the kerb that is away from the carriageway."""
    foot, (dx, dy) = kerb.at(station_m)
    here = translate(at, -foot.x, -foot.y)
    return bool((dx * here.y - dy * here.x) * kerb.outward >= 0)


AREA_REACH_M = 12.0
"""An area of parking belongs to a kerb at most this far from it [m]."""

AREA_MARGIN_M = 1.0
"""The centre of a place in an area lies at most this far outside of it [m]."""

SAME_PLACE_M = 0.2
"""Rows whose distance from the kerb differs by less are one [m]."""

MPS_PER_KMH = 1 / 3.6

LANE_TOLERANCE_M = 0.02
"""SUMO's network has widths of lanes to the centimetre."""


@dataclass(frozen=True, slots=True)
class KerbRow:
    """A stretch of a kerb with one kind of parking."""

    kerb: Kerb
    interval: KerbInterval
    parking: SideParking
    source: ParkingSource
    inner_m: float
    """Inner edge of its places, outwards from the kerb; below 0 on the carriageway."""
    within: Polygon | None = None
    """Mapped area that contains the centres of its places."""


class KerbRows:
    """Finds the rows of every kerb of a world.

    Args:
        planned: place rows on the carriageway where the map or the rule has them; otherwise only on parking lanes.
    """

    def __init__(
        self, kerbs: Sequence[Kerb], mapped: ParkingMap, houses: Sequence[Polygon], rule: ParkingRule, *, planned: bool
    ) -> None:
        self._rule = rule
        self._planned = planned
        self._ways = WayIndex(mapped.ways)
        self._houses = STRtree(houses)
        self._by_rule: dict[str, bool] = {}
        self._areas: dict[tuple[str, StreetSide], list[MappedArea]] = {}
        tree = STRtree([kerb.line for kerb in kerbs])
        for area in mapped.areas:
            near = [kerbs[int(index)] for index in tree.query(area.polygon, "dwithin", distance=AREA_REACH_M)]
            named = [kerb for kerb in near if kerb.street.street.name == area.street_name]
            if near:
                middle = area.polygon.centroid
                nearest = min(named or near, key=lambda kerb: (kerb.line.distance(middle), kerb.edge, kerb.side))
                self._areas.setdefault((nearest.edge, nearest.side), []).append(area)

    def of_areas(self, kerb: Kerb) -> Iterator[KerbRow]:
        """The rows in parking areas along a kerb."""
        for area in self._areas.get((kerb.edge, kerb.side), ()):
            corners = shapely.points(area.polygon.exterior.coords)
            stations = shapely.line_locate_point(kerb.line, corners)
            inner = self._inner_m(kerb, area.parking)
            if inner is None:
                continue
            inner = inner or float(kerb.line.distance(area.polygon))
            interval = float(stations.min()), float(stations.max())
            yield KerbRow(kerb, interval, area.parking, ParkingSource.AREA, inner, area.polygon.buffer(AREA_MARGIN_M))

    def along(self, kerb: Kerb) -> Iterator[KerbRow]:
        """The rows that the tags of ways, else the rule, give to a kerb; each as long as it is the same."""
        last: KerbRow | None = None
        for row in self._by_stretch(kerb):
            if last is not None and _continues(last, row):
                last = replace(last, interval=(last.interval[0], row.interval[1]))
                continue
            if last is not None:
                yield last
            last = row
        if last is not None:
            yield last

    def _by_stretch(self, kerb: Kerb) -> Iterator[KerbRow]:
        for stretch in self._ways.stretches(kerb):
            tagged = stretch.way.sides[stretch.side] if stretch.way else UNMAPPED
            by_rule = tagged.provision is Provision.UNMAPPED
            parking = self._by_rule_of(kerb, stretch) if by_rule else tagged
            inner = self._inner_m(kerb, parking)
            if parking.provision is Provision.PLACES and inner is not None:
                source = ParkingSource.RULE if by_rule else ParkingSource.TAGGED
                yield KerbRow(kerb, (stretch.start_m, stretch.end_m), parking, source, inner)

    def _inner_m(self, kerb: Kerb, parking: SideParking) -> float | None:
        """Inner edge of a row, outwards from the kerb; None where it needs a parking lane that does not exist."""
        needed = lane_depth_m(parking.position, self._depth_m(parking))
        return -needed if self._planned or needed <= kerb.parking_m + LANE_TOLERANCE_M else None

    def _by_rule_of(self, kerb: Kerb, stretch: Stretch) -> SideParking:
        street = kerb.street
        rule = self._rule.of_street(street.street.kind)
        if street.street.id not in self._by_rule:
            self._by_rule[street.street.id] = self._is_parked_along(street)
        if rule.sides == "none" or not self._by_rule[street.street.id] or (stretch.way and stretch.way.elevated):
            return NO_PLACES
        parking = SideParking(Provision.PLACES, rule.position, rule.orientation)
        width, sides = stretch.way.width_m if stretch.way else kerb.driven_m, 1 if rule.sides == "right" else 2
        if width is not None:
            sides = min(sides, int((width - rule.passage_m) // self._depth_m(parking)))
        return parking if sides == 2 or (sides == 1 and kerb.side is StreetSide.RIGHT) else NO_PLACES

    def _is_parked_along(self, street: StreetSurface) -> bool:
        """Whether lanes, limit and houses of a street are as its rule asks."""
        rule = self._rule.of_street(street.street.kind)
        limit = max(edge.speed_limit_mps for edge in street.edges)
        if street.lanes > rule.max_lanes or limit > rule.max_speed_kmh * MPS_PER_KMH + 0.1:
            return False
        reach = float(street.polygon.area) / street.length_m / 2 + self._rule.built_up_reach_m
        stations = np.arange(0.5, street.length_m, 5.0)
        points = shapely.line_interpolate_point(street.centre_line, stations)
        beside = np.unique(self._houses.query(points, predicate="dwithin", distance=reach)[0])
        return len(beside) >= rule.built_up_share * len(stations)

    def _depth_m(self, parking: SideParking) -> float:
        return depth_m(self._rule.places[parking.orientation])


def _continues(row: KerbRow, other: KerbRow) -> bool:
    """Whether another row goes on where a row ends; a mapped capacity belongs to one way alone."""
    return (
        row.interval[1] == other.interval[0]
        and row.parking == other.parking
        and row.parking.capacity is None
        and row.source is other.source
        and abs(row.inner_m - other.inner_m) < SAME_PLACE_M
    )


TOUCHING_M = 0.05
"""Places and surfaces that overlap by less only touch [m]."""


def parking_places(
    net: RoadNet,
    streets: Sequence[StreetSurface],
    segments: Sequence[Segment],
    buildings: Iterable[Building],
    furniture: Iterable[Furniture],
    mapped: ParkingMap,
    rule: ParkingRule,
    *,
    planned: bool = False,
) -> tuple[ParkingPlace, ...]:
    """The parking places of a world, in the order of its streets; metres, world frame.

    Places in areas of the map come first, then those of its tags, then those by rule; of two overlapping places, the
    first is kept.

    Args:
        planned: the network has no parking lanes yet; places that will lie on them lie on the other lanes instead.
    """
    houses = [building.polygon for building in buildings]
    kerbs = list(kerbs_of(streets, net.left_hand))
    clear = ClearKerbs(net, streets, mapped, furniture, rule.clear)
    found = KerbRows(kerbs, mapped, houses, rule, planned=planned)
    in_areas = [row for kerb in kerbs for row in found.of_areas(kerb)]
    along = [row for kerb in kerbs for row in found.along(kerb)]
    along.sort(key=lambda row: row.source != "tagged")
    ground = _Ground(net, streets, segments, houses, rule, planned=planned)
    for row in (*in_areas, *along):
        ground.fill(row, clear)
    order = {street.street.id: number for number, street in enumerate(streets)}
    return tuple(sorted(ground.places, key=lambda place: (order[place.street], place.side, place.id)))


class _Ground:
    """Obstacles to places, and the places so far."""

    def __init__(
        self,
        net: RoadNet,
        streets: Sequence[StreetSurface],
        segments: Sequence[Segment],
        houses: Sequence[Polygon],
        rule: ParkingRule,
        *,
        planned: bool,
    ) -> None:
        self._rule = rule
        self._houses = STRtree(houses)
        self._crossed = STRtree(
            [junction.polygon for junction in net.junctions] + [crossing.polygon for crossing in net.crossings]
        )
        self._streets = streets
        self._street_tree = STRtree([street.polygon for street in streets])
        self._segments: dict[tuple[str, ...], list[Segment]] = {}
        for segment in segments:
            self._segments.setdefault(segment.edges, []).append(segment)
        self._planned = planned
        self._taken: dict[object, Nearby[Polygon]] = defaultdict(lambda: Nearby(16.0))
        """Places by kerb while lanes are planned: they will lie side by side, however narrow the street is now."""
        self.places: list[ParkingPlace] = []

    def fill(self, row: KerbRow, clear: ClearKerbs) -> None:
        """Add the places of a row that have room."""
        size = self._rule.places[row.parking.orientation]
        free = list(_within(row.interval, clear.free(row.kerb, (row.inner_m, row.inner_m + depth_m(size)))))
        spacing = spacing_for(row.parking.capacity, sum(end - start for start, end in free), size)
        for interval in free:
            for slot in slots_in(row.kerb, interval, row.parking.orientation, row.inner_m, self._rule, spacing):
                if row.within is not None and not row.within.contains(slot.centre):
                    continue
                street = row.kerb.street.street
                pieces = self._segments.get(street.edges)
                if not pieces:
                    continue
                place = ParkingPlace(
                    id=f"{row.kerb.edge}:{row.kerb.side[0]}{slot.station_m:.0f}",
                    street=street.id,
                    segment=min(pieces, key=lambda piece: piece.centre_line.distance(slot.centre)).id,
                    side=row.kerb.side,
                    position=row.parking.position,
                    orientation=row.parking.orientation,
                    centre=slot.centre,
                    yaw_rad=slot.yaw_rad,
                    length_m=slot.length_m,
                    width_m=slot.width_m,
                    source=row.source,
                    closed=row.parking.closed,
                )
                self._add(place, row.kerb.street)

    def _add(self, place: ParkingPlace, street: StreetSurface) -> None:
        polygon = place.polygon
        core = polygon.buffer(-TOUCHING_M, join_style="mitre")
        if len(self._crossed.query(core, predicate="intersects")):
            return
        if len(self._houses.query(polygon, predicate="dwithin", distance=self._rule.clear.walkway_m)):
            return
        others = (self._streets[int(index)] for index in self._street_tree.query(core, predicate="intersects"))
        if any(other is not street for other in others):
            return
        taken = self._taken[(place.edge, place.side) if self._planned else None]
        if any(core.intersects(other) for other in taken.query(polygon.bounds)):
            return
        taken.add(polygon.bounds, polygon)
        self.places.append(place)


def _within(whole: KerbInterval, parts: Iterable[KerbInterval]) -> Iterator[KerbInterval]:
    """The parts of intervals that lie within another."""
    for start, end in parts:
        if min(end, whole[1]) > max(start, whole[0]):
            yield max(start, whole[0]), min(end, whole[1])


def on_carriageway(world: World) -> Float64Array:
    """The share of each place's area that lies on the segments of its world, 0 … 1, (places,)."""
    places = np.array([place.polygon for place in world.parking], dtype=object)
    surfaces = np.array([segment.polygon for segment in world.segments], dtype=object)
    place, surface = shapely.STRtree(surfaces).query(places, predicate="intersects")
    shared = shapely.area(shapely.intersection(places[place], surfaces[surface]))
    covered = np.bincount(place, weights=shared, minlength=len(places))
    return np.asarray(covered / shapely.area(places), dtype=np.float64)
