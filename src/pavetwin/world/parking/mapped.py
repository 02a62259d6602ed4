"""Parking on a map: tags of streets, areas along streets, obstacles that interrupt a row, and hours of restrictions.

Both schemes of tags are read: `parking:SIDE` with `:orientation`, `:capacity`, `:restriction`,
`:restriction:conditional` and `:access`, and the deprecated `parking:lane:SIDE` with `parking:condition:SIDE`. The
former counts where a side has both.

Hours are a part of OSM's opening hours: days of the week and times, such as `Mo-Fr 07:00-17:00; Sa 09:00-14:00`,
`Mo,We 08:00-12:00`, `08:00-18:00` and `24/7`. Holidays are ordinary days. A text with anything else in it closes no
place.
"""

import datetime as dt
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from shapely import LineString, Point, Polygon

from pavetwin.world.network import is_street
from pavetwin.world.osm_file import metres
from pavetwin.world.parking.place import ParkingOrientation, ParkingPosition, StreetSide

DAYS: Final = ("Mo", "Tu", "We", "Th", "Fr", "Sa", "Su")

_CONDITION = re.compile(r"\s*(?P<value>[^@;]+?)\s*@\s*(?:\((?P<inside>[^)]*)\)|(?P<plain>[^;()]+))\s*(?:;|$)")
_TIMES = r"\d{1,2}:\d{2}-\d{1,2}:\d{2}"
_RULE = re.compile(
    rf"(?:(?P<days>[A-Z][a-z](?:-[A-Z][a-z])?(?:,\s*[A-Z][a-z](?:-[A-Z][a-z])?)*)\s*)?(?P<times>{_TIMES}(?:,\s*{_TIMES})*)?"
)

HoursRule = tuple[frozenset[int], tuple[tuple[int, int], ...]]
"""Days of the week, 0 Monday, and spans of minutes of the day."""


def conditional_hours(conditions: str, values: Collection[str]) -> str:
    """The hours in which one of `values` holds in a conditional tag such as `no_parking @ (Mo-Fr 08:00-16:00)`.

    Hours that cannot be read are left out.
    """
    found = [
        (match["inside"] or match["plain"] or "").strip()
        for match in _CONDITION.finditer(conditions)
        if match["value"] in values
    ]
    return "; ".join(hours for hours in found if hours and _rules(hours) is not None)


def is_within(hours: str, date: dt.date, time: dt.time) -> bool:
    """Whether a moment lies in hours; never in empty ones and in ones that cannot be read."""
    minute = time.hour * 60 + time.minute
    return any(
        date.weekday() in days and any(_in_span(minute, start, end) for start, end in spans)
        for days, spans in _rules(hours) or ()
    )


def _in_span(minute: int, start: int, end: int) -> bool:
    return start <= minute < end if start < end else minute >= start or minute < end


def _rules(hours: str) -> list[HoursRule] | None:
    """Rules of a text of hours; None where a part is not understood."""
    rules: list[HoursRule] = []
    for part in filter(None, (part.strip() for part in hours.split(";"))):
        match = _RULE.fullmatch(part)
        if part == "24/7":
            rules.append((frozenset(range(7)), ((0, 1440),)))
            continue
        if match is None:
            return None
        days = _days(match["days"] or "Mo-Su")
        if days is None:
            return None
        rules.append((days, tuple(_spans(match["times"] or "00:00-24:00"))))
    return rules


def _days(text: str) -> frozenset[int] | None:
    days: set[int] = set()
    for part in text.replace(" ", "").split(","):
        first, _, last = part.partition("-")
        if first not in DAYS or (last and last not in DAYS):
            return None
        start, end = DAYS.index(first), DAYS.index(last or first)
        days.update((start + step) % 7 for step in range((end - start) % 7 + 1))
    return frozenset(days)


def _spans(text: str) -> Iterator[tuple[int, int]]:
    for part in text.replace(" ", "").split(","):
        start, end = (int(clock[:-3]) * 60 + int(clock[-2:]) for clock in part.split("-"))
        yield start, end


class Provision(StrEnum):
    """Parking on a side of a street."""

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
    """Mapped number of places along the whole side of the way."""
    closed: str = ""
    """Hours without parking."""


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
    """Parking of an area `amenity=parking` that belongs to a street; None for car parks and without public parking."""
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


MOUTHS = frozenset({"service", "track", "services", "busway"})
"""Ways that open onto a street and whose mouth stays clear."""


class ObstacleKind(StrEnum):
    """Obstacle that interrupts a row of places."""

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
    """Width of the carriageway from kerb to kerb, with its parking lanes."""
    sides: Mapping[StreetSide, SideParking]
    elevated: bool
    """Whether it is on a bridge or in a tunnel."""


@dataclass(frozen=True, slots=True)
class MappedArea:
    """An area of parking that belongs to a street."""

    polygon: Polygon
    parking: SideParking
    street_name: str
    """Class of the street; empty where it is not mapped."""


@dataclass(slots=True)
class ParkingMap:
    """Parking along the streets of a map; empty without a map."""

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
    """Obstacle of a point of the map; None where it interrupts nothing."""
    if tags.get("highway") == "bus_stop":
        return ObstacleKind.BUS_STOP
    if tags.get("emergency") == "fire_hydrant":
        return ObstacleKind.HYDRANT
    if tags.get("highway") == "crossing":
        words = {tags.get("crossing", ""), tags.get("crossing:markings", "no")}
        unmarked = words <= {"", "unmarked", "no", "informal"}
        return ObstacleKind.CROSSING if unmarked else ObstacleKind.MARKED_CROSSING
    return None
