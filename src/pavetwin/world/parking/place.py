"""Parking places as values of a world."""

import zlib
from dataclasses import dataclass
from enum import StrEnum

from shapely import Point, Polygon, affinity, box


class StreetSide(StrEnum):
    """Of a street, along its centre line."""

    LEFT = "left"
    RIGHT = "right"


class ParkingPosition(StrEnum):
    """Where a place lies across the street, in the words of OSM's `parking:SIDE`."""

    LANE = "lane"
    """On the carriageway, along its kerb."""
    HALF_ON_KERB = "half_on_kerb"
    """Two wheels on the sidewalk."""
    ON_KERB = "on_kerb"
    """On the sidewalk."""
    STREET_SIDE = "street_side"
    """In a bay beside the carriageway."""


class ParkingOrientation(StrEnum):
    """How a parked vehicle stands to the kerb."""

    PARALLEL = "parallel"
    DIAGONAL = "diagonal"
    PERPENDICULAR = "perpendicular"


class ParkingSource(StrEnum):
    """How a place came into the world."""

    TAGGED = "tagged"
    """By the `parking:*` tags of its street."""
    AREA = "area"
    """Within an area of parking that the map has beside the street."""
    RULE = "rule"
    """By the rule for its type of street; the map says nothing."""


@dataclass(frozen=True, slots=True)
class ParkingPlace:
    """A rectangle at a street in which one vehicle parks."""

    id: str
    """The directed edge whose kerb it lies at and a number along it; it does not depend on other streets."""
    street: str
    """The id of its street."""
    segment: str
    """The id of the segment that it lies at."""
    side: StreetSide
    position: ParkingPosition
    orientation: ParkingOrientation
    centre: Point
    """Metres, world frame."""
    yaw_rad: float
    """Direction in which a vehicle parked forwards looks, anticlockwise from east."""
    length_m: float
    """Along `yaw_rad`."""
    width_m: float
    """Across `yaw_rad`."""
    source: ParkingSource
    closed: str = ""
    """Hours in which nobody parks there, such as `Mo-Fr 07:00-17:00` of a loading bay; see `hours`."""

    @property
    def edge(self) -> str:
        """The directed edge whose kerb it lies at."""
        return self.id.rpartition(":")[0]

    @property
    def polygon(self) -> Polygon:
        """The rectangle."""
        corners = affinity.rotate(
            box(-self.length_m / 2, -self.width_m / 2, self.length_m / 2, self.width_m / 2),
            self.yaw_rad,
            origin=(0.0, 0.0),
            use_radians=True,
        )
        return affinity.translate(corners, self.centre.x, self.centre.y)

    @property
    def key(self) -> int:
        """A number derived from the id alone; it keys the random seeds of this place."""
        return zlib.crc32(self.id.encode())
