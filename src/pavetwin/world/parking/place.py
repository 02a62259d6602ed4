"""Parking places as values of a world."""

import zlib
from dataclasses import dataclass
from enum import StrEnum

from shapely import Point, Polygon, affinity, box


class StreetSide(StrEnum):
    """Side of a street, along its centre line."""

    LEFT = "left"
    RIGHT = "right"


class ParkingPosition(StrEnum):
    """Position of a place across the street, with the values of OSM's `parking:SIDE`."""

    LANE = "lane"
    """Carriageway, along its kerb."""
    HALF_ON_KERB = "half_on_kerb"
    """Two wheels on the sidewalk."""
    ON_KERB = "on_kerb"
    """Sidewalk."""
    STREET_SIDE = "street_side"
    """Bay next to the carriageway."""


class ParkingOrientation(StrEnum):
    """Orientation of a parked vehicle to the kerb."""

    PARALLEL = "parallel"
    DIAGONAL = "diagonal"
    PERPENDICULAR = "perpendicular"


class ParkingSource(StrEnum):
    """Source of a place."""

    TAGGED = "tagged"
    """`parking:*` tags of its street."""
    AREA = "area"
    """Mapped parking area along the street."""
    RULE = "rule"
    """Rule for its type of street; the map has no tag."""


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
    """Width across `yaw_rad`."""
    source: ParkingSource
    closed: str = ""
    """Hours without parking, such as `Mo-Fr 07:00-17:00` of a loading bay."""

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
