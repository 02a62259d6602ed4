"""What the tags of a way in OpenStreetMap say about parking along its two sides.

Read are both schemes: `parking:SIDE` with `:orientation`, `:capacity`, `:restriction`, `:restriction:conditional` and
`:access`, and the older `parking:lane:SIDE` with `parking:condition:SIDE`. The newer one counts where a side has both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from pavetwin.world.parking.hours import conditional_hours
from pavetwin.world.parking.model import ParkingOrientation, ParkingPosition, StreetSide


class Provision(StrEnum):
    """What a side of a street has."""

    PLACES = "places"
    NONE = "none"
    SEPARATE = "separate"
    """Mapped as areas of their own."""
    UNMAPPED = "unmapped"


@dataclass(frozen=True, slots=True)
class SideParking:
    """Parking along one side of a way."""

    provision: Provision
    position: ParkingPosition = ParkingPosition.LANE
    orientation: ParkingOrientation = ParkingOrientation.PARALLEL
    capacity: int | None = None
    """Places along the whole side of the way, where the map says so."""
    closed: str = ""
    """Hours in which nobody parks, as in `hours`."""


UNMAPPED: Final = SideParking(Provision.UNMAPPED)
NO_PLACES: Final = SideParking(Provision.NONE)

POSITIONS: Final[Mapping[str, ParkingPosition]] = {
    "lane": ParkingPosition.LANE,
    "yes": ParkingPosition.LANE,
    "on_street": ParkingPosition.LANE,
    "painted_area_only": ParkingPosition.LANE,
    "half_on_kerb": ParkingPosition.HALF_ON_KERB,
    "on_kerb": ParkingPosition.ON_KERB,
    "street_side": ParkingPosition.STREET_SIDE,
    "lay_by": ParkingPosition.STREET_SIDE,
    "shoulder": ParkingPosition.STREET_SIDE,
}
"""Values of either scheme."""

FORBIDDEN: Final = frozenset(
    {"no_parking", "no_stopping", "no_standing", "loading_only", "charging_only", "fire_lane", "no"}
)
"""Restrictions under which no vehicle stays."""

OLD_RESTRICTIONS: Final = FORBIDDEN - {"no"}


def sides_of(tags: Mapping[str, str]) -> Mapping[StreetSide, SideParking]:
    """Parking on the left and on the right of a way, seen in its direction."""
    return {side: _new_scheme(tags, side) or _old_scheme(tags, side) or UNMAPPED for side in StreetSide}


def area_parking(tags: Mapping[str, str]) -> SideParking | None:
    """Of an area of `amenity=parking` that belongs to a street; None for car parks and where nobody may park."""
    position = POSITIONS.get(tags.get("parking", ""))
    if tags.get("amenity") != "parking" or position is None or tags.get("parking") == "yes":
        return None
    if tags.get("restriction") in FORBIDDEN or (tags.get("access") == "no" and "disabled" not in tags):
        return None
    return SideParking(
        Provision.PLACES,
        position,
        _orientation(tags.get("orientation", "")) or ParkingOrientation.PARALLEL,
        _count(tags.get("capacity")),
        conditional_hours(tags.get("restriction:conditional", ""), FORBIDDEN),
    )


def _new_scheme(tags: Mapping[str, str], side: StreetSide) -> SideParking | None:
    def given(key: str) -> str:
        return tags.get(f"parking:{side}{key}") or tags.get(f"parking:both{key}") or ""

    value, orientation = given(""), _orientation(given(":orientation"))
    if given(":restriction") in FORBIDDEN or given(":access") == "no" or value in ("no", "none"):
        return NO_PLACES
    if value == "separate":
        return SideParking(Provision.SEPARATE)
    if value not in POSITIONS and orientation is None:
        return None
    return SideParking(
        Provision.PLACES,
        POSITIONS.get(value, ParkingPosition.LANE),
        orientation or ParkingOrientation.PARALLEL,
        _count(given(":capacity")),
        conditional_hours(given(":restriction:conditional"), FORBIDDEN),
    )


def _old_scheme(tags: Mapping[str, str], side: StreetSide) -> SideParking | None:
    def given(prefix: str, key: str = "") -> str:
        return tags.get(f"parking:{prefix}:{side}{key}") or tags.get(f"parking:{prefix}:both{key}") or ""

    value, condition = given("lane"), given("condition")
    interval = given("condition", ":time_interval")
    closed = ""
    if condition in OLD_RESTRICTIONS:
        if not interval:
            return NO_PLACES
        closed = conditional_hours(f"{condition} @ ({interval})", FORBIDDEN)
    if value in FORBIDDEN:
        return NO_PLACES
    if value == "separate":
        return SideParking(Provision.SEPARATE)
    orientation = _orientation(value)
    if orientation is None and value not in ("marked", "yes"):
        return None
    position = POSITIONS.get(given("lane", f":{value}"), ParkingPosition.LANE)
    return SideParking(
        Provision.PLACES,
        position,
        orientation or ParkingOrientation.PARALLEL,
        _count(given("lane", ":capacity")),
        closed,
    )


def _orientation(value: str) -> ParkingOrientation | None:
    return ParkingOrientation(value) if value in list(ParkingOrientation) else None


def _count(text: str | None) -> int | None:
    return int(text) if text and text.isdecimal() else None
