"""Rows of parking along each kerb: what the map's tags and areas say there, else what the rule says."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon, STRtree

from pavetwin.world.model import LaneKind
from pavetwin.world.parking.kerbs import Kerb, KerbInterval, Stretch, WayIndex
from pavetwin.world.parking.layout import depth_m, overlap_m
from pavetwin.world.parking.mapped import MappedArea, ParkingMap
from pavetwin.world.parking.model import ParkingSource, StreetSide
from pavetwin.world.parking.rule import ParkingRule
from pavetwin.world.parking.tags import NO_PLACES, UNMAPPED, Provision, SideParking
from pavetwin.world.roadnet import RoadNet
from pavetwin.world.streets import StreetSurface

AREA_REACH_M = 12.0
"""An area of parking belongs to a kerb at most this far from it [m]."""

AREA_MARGIN_M = 1.0
"""The centre of a place in an area lies at most this far outside of it [m]."""

SAME_PLACE_M = 0.2
"""Rows whose distance from the kerb differs by less are one [m]."""

MPS_PER_KMH = 1 / 3.6

OTHER_SIDE = {StreetSide.LEFT: StreetSide.RIGHT, StreetSide.RIGHT: StreetSide.LEFT}


@dataclass(frozen=True, slots=True)
class KerbRow:
    """A stretch of a kerb with one kind of parking."""

    kerb: Kerb
    interval: KerbInterval
    parking: SideParking
    source: ParkingSource
    inner_m: float
    """Where its places begin, outwards from the kerb; below 0 on the carriageway."""
    within: Polygon | None = None
    """What the centres of its places lie in, in an area of the map."""


class KerbRows:
    """Finds the rows of every kerb of a world."""

    def __init__(
        self, kerbs: Sequence[Kerb], net: RoadNet, mapped: ParkingMap, houses: Sequence[Polygon], rule: ParkingRule
    ) -> None:
        self._rule = rule
        self._ways = WayIndex(mapped.ways)
        self._houses = STRtree(houses)
        lanes = [lane for edge in net.edges.values() for lane in edge.lanes if lane.kind is LaneKind.SIDEWALK]
        self._sidewalks = STRtree([lane.centre_line.buffer(lane.width_m / 2, cap_style="flat") for lane in lanes])
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
        """The rows in areas of parking beside a kerb."""
        for area in self._areas.get((kerb.edge, kerb.side), ()):
            corners = shapely.points(area.polygon.exterior.coords)
            stations = shapely.line_locate_point(kerb.line, corners)
            overlap = overlap_m(area.parking.position, self._depth_m(area.parking), kerb.width_m, kerb.width_m)
            inner = -overlap if overlap else float(kerb.line.distance(area.polygon))
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
            here, opposite = (self._parking(kerb, stretch, side) for side in (kerb.side, OTHER_SIDE[kerb.side]))
            if here.provision is Provision.PLACES:
                source = ParkingSource.RULE if tagged.provision is Provision.UNMAPPED else ParkingSource.TAGGED
                inner = -self._overlap_m(kerb, stretch, here, opposite)
                yield KerbRow(kerb, (stretch.start_m, stretch.end_m), here, source, inner)

    def _parking(self, kerb: Kerb, stretch: Stretch, side: StreetSide) -> SideParking:
        """Along one side of the street beside a stretch of a kerb."""
        if stretch.way is not None:
            tagged = stretch.way.sides[stretch.side if side is kerb.side else OTHER_SIDE[stretch.side]]
            if tagged.provision is not Provision.UNMAPPED:
                return tagged
        return self._by_rule_of(kerb, stretch, side)

    def _by_rule_of(self, kerb: Kerb, stretch: Stretch, side: StreetSide) -> SideParking:
        street = kerb.street
        rule = self._rule.of_street(street.street.kind)
        if street.street.id not in self._by_rule:
            self._by_rule[street.street.id] = self._is_parked_along(street)
        if rule.sides == "none" or not self._by_rule[street.street.id] or (stretch.way and stretch.way.elevated):
            return NO_PLACES
        parking = SideParking(Provision.PLACES, rule.position, rule.orientation)
        width, sides = self._kerb_to_kerb_m(kerb, stretch), 1 if rule.sides == "right" else 2
        if width is not None:
            sides = min(sides, int((width - rule.passage_m) // self._depth_m(parking)))
        return parking if sides == 2 or (sides == 1 and side is StreetSide.RIGHT) else NO_PLACES

    def _kerb_to_kerb_m(self, kerb: Kerb, stretch: Stretch) -> float | None:
        """Of the carriageway with its parking lanes; None where a map has no width, only numbers of lanes."""
        return stretch.way.width_m if stretch.way is not None else kerb.width_m

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

    def _overlap_m(self, kerb: Kerb, stretch: Stretch, here: SideParking, opposite: SideParking) -> float:
        """How much of the row's depth lies on the carriageway.

        None, where neither a sidewalk nor a mapped kerb is beside the lanes; less than all where too narrow a passage
        would be left.
        """
        width, mapped = kerb.width_m, self._kerb_to_kerb_m(kerb, stretch)
        if mapped is None and not self._is_beside_sidewalk(kerb, stretch):
            return 0.0
        on_here, on_opposite = (
            overlap_m(side.position, self._depth_m(side), width, mapped) if side.provision is Provision.PLACES else 0.0
            for side in (here, opposite)
        )
        together = on_here + on_opposite
        room = max(0.0, width - self._rule.of_street(kerb.street.street.kind).passage_m)
        return on_here if together <= room else on_here * room / together

    def _is_beside_sidewalk(self, kerb: Kerb, stretch: Stretch) -> bool:
        point, _ = kerb.at((stretch.start_m + stretch.end_m) / 2)
        return bool(len(self._sidewalks.query(point, predicate="dwithin", distance=SAME_PLACE_M)))


def _continues(row: KerbRow, other: KerbRow) -> bool:
    """Whether another row goes on where a row ends; a mapped capacity belongs to one way alone."""
    return (
        row.interval[1] == other.interval[0]
        and row.parking == other.parking
        and row.parking.capacity is None
        and row.source is other.source
        and abs(row.inner_m - other.inner_m) < SAME_PLACE_M
    )
