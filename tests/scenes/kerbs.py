"""Streets to park along, made without SUMO: straight, from the origin to the east, with their tags in a map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from shapely import LineString, Point, Polygon

from pavetwin.world.model import Building, Furniture, FurnitureKind, Junction, Lane, LaneKind
from pavetwin.world.parking.lanes import EdgeLanes, parking_lanes
from pavetwin.world.parking.mapped import MappedArea, Obstacle, ObstacleKind, ParkingMap, area_parking
from pavetwin.world.parking.place import ParkingPlace
from pavetwin.world.parking.places import parking_places
from pavetwin.world.parking.rule import ParkingRule, parking_rule
from pavetwin.world.roadnet import Edge, RoadNet
from pavetwin.world.segments import segments_of, streets_of

SPEED = 13.9


def europe() -> ParkingRule:
    """The rule that worlds have by default."""
    rule = parking_rule("europe")
    assert rule is not None
    return rule


@dataclass(frozen=True)
class Scene:
    """A street 100 m long, its lanes 3.25 m wide by default."""

    length_m: float = 100.0
    lane_m: float = 3.25
    one_way: bool = False
    left_hand: bool = False
    sidewalks: bool = True
    kind: str = "highway.residential"
    tags: Mapping[str, str] | None = None
    """Tags of the mapped way, from west to east; None without a map."""
    areas: Sequence[tuple[Polygon, Mapping[str, str]]] = ()
    obstacles: Sequence[tuple[ObstacleKind, tuple[float, float]]] = ()
    mouths: Sequence[LineString] = ()
    buildings: Sequence[Polygon] = ()
    masts: Sequence[tuple[float, float]] = ()
    side_street_at: float | None = None
    """A street to the south begins here, at a junction 10 m wide that splits this one."""

    def net(self, changed: Mapping[str, EdgeLanes] = MappingProxyType({})) -> RoadNet:
        """The network, with edges `east` (from west to east) and `west`, and the parking lanes that it is given."""
        south = -1 if not self.left_hand else 1
        edges: dict[str, Edge] = {}

        def add(name: str, start: str, end: str, a: tuple[float, float], b: tuple[float, float]) -> None:
            ahead = (b[0] - a[0], b[1] - a[1])
            length = (ahead[0] ** 2 + ahead[1] ** 2) ** 0.5
            out = (-ahead[1] / length * south, ahead[0] / length * south)
            new = changed.get(name, EdgeLanes(driving_m=(self.lane_m,)))
            (lane_m,) = new.driving_m
            inner = -(new.kerb_m + lane_m + new.far_m) / 2 if self.one_way and name in ("east", "east2") else 0.0
            row = [
                (LaneKind.PARKING, new.far_m),
                (LaneKind.DRIVING, lane_m),
                (LaneKind.PARKING, new.kerb_m),
                (LaneKind.SIDEWALK, 2.0 if self.sidewalks else 0.0),
            ]
            lanes: list[Lane] = []
            for kind, width in row:
                if width:
                    lanes.append(self._lane(name, 0, kind, a, b, out, inner + width / 2, width))
                    inner += width
            lanes = [replace(lane, index=index) for index, lane in enumerate(reversed(lanes))]
            edges[name] = Edge(name, start, end, "Allee", self.kind, tuple(lanes), for_cars=True)

        junctions = []
        if self.side_street_at is None:
            pieces = [("", 0.0, self.length_m, "a", "b")]
        else:
            at = self.side_street_at
            pieces = [("", 0.0, at - 5, "a", "j"), ("2", at + 5, self.length_m, "j", "b")]
            half = self.lane_m + 2
            square = Polygon([(at - 5, -half), (at + 5, -half), (at + 5, half), (at - 5, half)])
            junctions.append(Junction("j", "priority", square))
        for suffix, x0, x1, start, end in pieces:
            add(f"east{suffix}", start, end, (x0, 0.0), (x1, 0.0))
            if not self.one_way:
                add(f"west{suffix}", end, start, (x1, 0.0), (x0, 0.0))
        if self.side_street_at is not None:
            foot = (self.side_street_at, -self.lane_m - 2)
            add("south", "j", "c", foot, (self.side_street_at, -80.0))
            add("north", "c", "j", (self.side_street_at, -80.0), foot)
        return RoadNet(edges, tuple(junctions), (), (), {}, {}, self.left_hand)

    def _lane(
        self,
        edge: str,
        index: int,
        kind: LaneKind,
        a: tuple[float, float],
        b: tuple[float, float],
        out: tuple[float, float],
        apart_m: float,
        width_m: float,
    ) -> Lane:
        line = LineString([(x + apart_m * out[0], y + apart_m * out[1]) for x, y in (a, b)])
        return Lane(f"{edge}_{index}", edge, index, kind, line, width_m, SPEED)

    def mapped(self) -> ParkingMap:
        """Parking by its map."""
        found = ParkingMap()
        if self.tags is not None:
            tags = {"highway": self.kind.removeprefix("highway."), "name": "Allee", **self.tags}
            found.take_way(LineString([(-20, 0), (self.length_m + 20, 0)]), tags)
        for polygon, tags in self.areas:
            parking = area_parking({"amenity": "parking", **tags})
            if parking is not None:
                found.areas.append(MappedArea(polygon, parking, "Allee"))
        found.obstacles += [Obstacle(kind, Point(at)) for kind, at in self.obstacles]
        found.mouths += self.mouths
        return found

    def lanes(self, rule: ParkingRule | None = None) -> dict[str, EdgeLanes]:
        """Lanes of its edges with parking."""
        net = self.net()
        streets = streets_of(net)
        houses = self._houses()
        polygons = [house.polygon for house in houses]
        return parking_lanes(net, streets, segments_of(streets), houses, self.mapped(), rule or europe(), polygons)

    def places(self, rule: ParkingRule | None = None) -> tuple[ParkingPlace, ...]:
        """Its parking places."""
        net = self.net(self.lanes(rule))
        streets = streets_of(net)
        masts = [Furniture(f"m{n}", FurnitureKind.POLE, Point(at), 9.0, 0.12) for n, at in enumerate(self.masts)]
        return parking_places(
            net, streets, segments_of(streets), self._houses(), masts, self.mapped(), rule or europe()
        )

    def _houses(self) -> list[Building]:
        return [Building(f"b{number}", polygon, 9.0) for number, polygon in enumerate(self.buildings)]
