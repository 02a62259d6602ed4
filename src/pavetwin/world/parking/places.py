"""All parking places of a world: row by row along its kerbs, wherever nothing else is in the way."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

from shapely import Polygon, STRtree

from pavetwin.world.ground import Nearby
from pavetwin.world.model import Building, Furniture, Segment
from pavetwin.world.parking.clearances import ClearKerbs
from pavetwin.world.parking.kerbs import KerbInterval, kerbs_of
from pavetwin.world.parking.layout import depth_m, slots_in, spacing_for
from pavetwin.world.parking.mapped import ParkingMap
from pavetwin.world.parking.model import ParkingPlace
from pavetwin.world.parking.rows import KerbRow, KerbRows
from pavetwin.world.parking.rule import ParkingRule
from pavetwin.world.roadnet import RoadNet
from pavetwin.world.streets import StreetSurface

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

    Places in areas of the map come first, then those of its tags, then those by rule: of two that overlap the earlier
    one stays.

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
    """What stands in the way of places, and the places so far."""

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
        """By kerb while lanes are planned: they will lie side by side, however narrow the street is before."""
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
