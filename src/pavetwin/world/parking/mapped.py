"""What a map says about parking: the streets' tags, areas beside streets, and what interrupts a row of places.

Coordinates are in the world frame (metres).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from shapely import LineString, Point, Polygon

from pavetwin.world.network import is_street
from pavetwin.world.parking.model import StreetSide
from pavetwin.world.parking.tags import SideParking, sides_of
from pavetwin.world.tags import metres

MOUTHS = frozenset({"service", "track", "services", "busway"})
"""Ways that open onto a street and whose mouth stays clear."""


class ObstacleKind(StrEnum):
    """What interrupts a row of places."""

    CROSSING = "crossing"
    MARKED_CROSSING = "marked_crossing"
    BUS_STOP = "bus_stop"
    HYDRANT = "hydrant"


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A point of the map that interrupts a row of places."""

    kind: ObstacleKind
    position: Point


@dataclass(frozen=True, slots=True)
class MappedWay:
    """A street of the map."""

    line: LineString
    name: str
    width_m: float | None
    """Of the carriageway from kerb to kerb, with its parking lanes."""
    sides: Mapping[StreetSide, SideParking]
    elevated: bool
    """On a bridge or in a tunnel."""


@dataclass(frozen=True, slots=True)
class MappedArea:
    """An area of parking that belongs to a street."""

    polygon: Polygon
    parking: SideParking
    street_name: str
    """Empty where the map does not say."""


@dataclass(slots=True)
class ParkingMap:
    """All that a map says about parking along streets; empty without a map."""

    ways: list[MappedWay] = field(default_factory=list)
    areas: list[MappedArea] = field(default_factory=list)
    obstacles: list[Obstacle] = field(default_factory=list)
    mouths: list[LineString] = field(default_factory=list)
    """Driveways and service roads."""

    def take_way(self, line: LineString, tags: Mapping[str, str]) -> None:
        """Note a way with a tag `highway`, where it matters."""
        if is_street(tags):
            width = metres(tags.get("width:carriageway")) or metres(tags.get("width"))
            elevated = any(tags.get(key, "no") != "no" for key in ("bridge", "tunnel"))
            self.ways.append(MappedWay(line, tags.get("name", ""), width, sides_of(tags), elevated))
        elif tags["highway"] in MOUTHS and tags.get("area") != "yes":
            self.mouths.append(line)


def obstacle_kind(tags: Mapping[str, str]) -> ObstacleKind | None:
    """Of a point of the map; None where it interrupts nothing."""
    if tags.get("highway") == "bus_stop":
        return ObstacleKind.BUS_STOP
    if tags.get("emergency") == "fire_hydrant":
        return ObstacleKind.HYDRANT
    if tags.get("highway") == "crossing":
        words = {tags.get("crossing", ""), tags.get("crossing:markings", "no")}
        unmarked = words <= {"", "unmarked", "no", "informal"}
        return ObstacleKind.CROSSING if unmarked else ObstacleKind.MARKED_CROSSING
    return None
