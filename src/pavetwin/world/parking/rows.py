"""Rows of parking along each kerb: what the map's tags and areas say there, else what the rule says."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon, STRtree

from pavetwin.world.parking.kerbs import Kerb, KerbInterval, Stretch, WayIndex
from pavetwin.world.parking.layout import depth_m, lane_depth_m
from pavetwin.world.parking.mapped import MappedArea, ParkingMap
from pavetwin.world.parking.model import ParkingSource, StreetSide
from pavetwin.world.parking.rule import ParkingRule
from pavetwin.world.parking.tags import NO_PLACES, UNMAPPED, Provision, SideParking
from pavetwin.world.streets import StreetSurface

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
    """Where its places begin, outwards from the kerb; below 0 on the carriageway."""
    within: Polygon | None = None
    """What the centres of its places lie in, in an area of the map."""


class KerbRows:
    """Finds the rows of every kerb of a world.

    Args:
        planned: rows on the carriageway go where the map or the rule asks for them; else only on parking lanes.
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
        """The rows in areas of parking beside a kerb."""
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
        """Where a row begins, outwards from the kerb; None where it needs a parking lane that is not there."""
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
