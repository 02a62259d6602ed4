"""Parking rules: sizes of places, clearances, and where vehicles park on streets without parking tags.

A rule is a YAML file of the form of `ParkingRule`. `europe` and `north_america` ship with the package; each names its
sources.
"""

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Final, Literal

from pydantic import Field

from pavetwin.config.named import names_in, read_named
from pavetwin.config.settings import Settings
from pavetwin.world.parking.place import ParkingOrientation, ParkingPosition

Metres = Annotated[float, Field(ge=0, le=100)]
PositiveMetres = Annotated[float, Field(gt=0, le=100)]

NO_RULE: Final = "none"
"""Instead of a rule's name: the world gets no parking places."""


class PlaceSize(Settings):
    """Size of a place of one orientation."""

    spacing_m: PositiveMetres
    """Along the kerb."""
    length_m: PositiveMetres
    """Along the parked vehicle."""
    width_m: PositiveMetres
    """Across the parked vehicle."""
    angle_deg: Annotated[float, Field(ge=0, le=90)]
    """Between the kerb and the parked vehicle."""


class Clearances(Settings):
    """Clearances along the kerb, in metres."""

    junction_m: Metres
    """Before and behind a junction, from where the edges of the two carriageways would meet."""
    signal_m: Metres
    """Before a traffic light."""
    marked_crossing_m: Metres
    """Before a marked crossing, from its edge."""
    crossing_half_width_m: Metres
    """From the middle of any crossing, to both sides."""
    bus_stop_m: Metres
    """Before and behind the sign of a bus stop."""
    driveway_m: Metres
    """From the middle of a driveway or of a service road's mouth, to both sides."""
    hydrant_m: Metres
    """From a fire hydrant, to both sides."""
    curve_radius_m: Metres
    """A kerb that is curved with a smaller radius stays clear."""
    mast_m: Metres
    """From a mast or trunk within the row, to both sides."""
    walkway_m: Metres
    """Between a place and a building."""


class StreetRule(Settings):
    """Parking along a type of street."""

    sides: Literal["both", "right", "none"]
    """`right`: seen in the direction in which the street was drawn."""
    position: ParkingPosition = ParkingPosition.LANE
    orientation: ParkingOrientation = ParkingOrientation.PARALLEL
    max_lanes: Annotated[int, Field(ge=1, le=20)] = 2
    """No places along streets with more driving lanes, both directions together."""
    max_speed_kmh: Annotated[float, Field(gt=0, le=200)] = 50.0
    passage_m: PositiveMetres = 3.05
    """Narrowest carriageway that parked vehicles leave."""
    built_up_share: Annotated[float, Field(ge=0, le=1)] = 0.33
    """Places only where buildings are near along at least this share of the street."""


class ParkingRule(Settings):
    """Sizes of places, clearances, and parking along streets without parking tags."""

    places: Mapping[ParkingOrientation, PlaceSize]
    clear: Clearances
    built_up_reach_m: PositiveMetres
    """A building at most this far from the kerb is near a street."""
    streets: Mapping[str, StreetRule]
    """Rules by OSM's class of street (`highway=*`)."""
    otherwise: StreetRule
    """Rule of streets without a class, as in generated worlds and SUMO networks."""

    def of_street(self, kind: str) -> StreetRule:
        """The rule for SUMO's type of an edge, such as `highway.residential`; none for a class that is not listed."""
        name = kind.removeprefix("highway.").removesuffix("_link")
        return self.streets.get(name, StreetRule(sides="none")) if kind.startswith("highway.") else self.otherwise


def rule_names() -> list[str]:
    """The rules that ship with the package."""
    return names_in("pavetwin.world.parking", "rules")


@cache
def parking_rule(name: str) -> ParkingRule | None:
    """Read a rule by name or from a YAML file; None for `none`.

    Raises:
        PaveTwinError: there is no such rule or file, or the file is not a rule.
    """
    if name == NO_RULE:
        return None
    return read_named(
        ParkingRule,
        name,
        what="parking rule",
        key="parking_rule",
        package="pavetwin.world.parking",
        folder="rules",
        more=[NO_RULE],
    )
