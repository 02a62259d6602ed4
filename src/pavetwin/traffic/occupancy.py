"""How many parking places are taken: a daily curve for each kind of surroundings.

The curves are in `occupancy.yaml`, which names its sources. Between full hours they are straight lines.
"""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, PositiveFloat

from pavetwin.config.conditions import Conditions
from pavetwin.config.settings import Settings, Share
from pavetwin.config.text import parse_yaml

SATURDAY: Final = 5
"""Of `datetime.date.weekday`: from here on it is the weekend."""

SPEED_ROUNDED_KMH: Final = 0.5
"""Networks hold speed limits in rounded metres a second: 13.89 for 50 km/h, or 13.9."""

Surroundings = Literal["residential", "mixed"]
DayKind = Literal["weekday", "weekend"]
DailyCurve = Annotated[tuple[Share, ...], Field(min_length=24, max_length=24)]
"""At each full hour, 0 to 23."""


class OccupancyCurves(Settings):
    """The contents of `occupancy.yaml`."""

    surroundings: Mapping[str, Surroundings]
    """By OSM's class of the street."""
    otherwise: Surroundings
    """Of all other streets."""
    unclassed_mixed_kmh: PositiveFloat
    """Streets without a class, as of generated towns and SUMO networks, are mixed from this speed limit on."""
    curves: Mapping[Surroundings, Mapping[DayKind, DailyCurve]]


@cache
def occupancy_curves() -> OccupancyCurves:
    """The curves that ship with the package."""
    name = "occupancy.yaml"
    text = (files("pavetwin.traffic") / name).read_text(encoding="utf-8")
    return OccupancyCurves.parse(parse_yaml(text, where=name), where=name)


def surroundings_of(street_kind: str, speed_limit_mps: float = 0.0) -> Surroundings:
    """From SUMO's type of an edge, such as `highway.residential`; without such a class from its speed limit."""
    data = occupancy_curves()
    if not street_kind.startswith("highway."):
        return "mixed" if 3.6 * speed_limit_mps >= data.unclassed_mixed_kmh - SPEED_ROUNDED_KMH else data.otherwise
    return data.surroundings.get(street_kind.removeprefix("highway.").removesuffix("_link"), data.otherwise)


def occupancy(surroundings: Surroundings, conditions: Conditions) -> float:
    """The share of places that are taken at the date and time of the conditions, 0 … 1."""
    day: DayKind = "weekend" if conditions.date.weekday() >= SATURDAY else "weekday"
    curve = occupancy_curves().curves[surroundings][day]
    hour = conditions.time.hour + conditions.time.minute / 60
    return float(np.interp(hour, np.arange(25), [*curve, curve[0]]))
