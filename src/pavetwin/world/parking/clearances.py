"""What stays clear along a kerb: at junctions, traffic lights, crossings, driveways, bus stops, hydrants and masts."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from shapely import LineString, Point, STRtree
from shapely.affinity import translate

from pavetwin.world.model import Furniture, FurnitureKind
from pavetwin.world.parking.kerbs import SHORTEST_M, Kerb, KerbInterval
from pavetwin.world.parking.mapped import Obstacle, ObstacleKind, ParkingMap
from pavetwin.world.parking.rule import Clearances
from pavetwin.world.roadnet import RoadNet
from pavetwin.world.segments import direction_at
from pavetwin.world.streets import StreetSurface

CONTINUES_RAD = math.radians(35.0)
"""A street that leaves a junction in line with another to within this is its continuation and no corner."""

CHORD_M = 4.0
"""Over which a kerb's curvature is measured, before and behind [m]."""

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
        """Before the crossing at the end of a kerb, which is a zebra where there is no map to say what it is."""
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
