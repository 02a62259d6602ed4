"""Missions that a browser may request, by names and numbers: no paths, policy files or plugins."""

import re
from typing import Annotated, Any, Final, Self

from pydantic import Field, StringConstraints, field_validator, model_validator

from pavetwin.config import MissionSettings, load_settings
from pavetwin.config.mission import check_altitude
from pavetwin.config.settings import Settings
from pavetwin.errors import PaveTwinError, no_such
from pavetwin.mission.planning import ALL, policies_named
from pavetwin.policies import policy_names
from pavetwin.sensing.sensor import sensor_names
from pavetwin.traffic.demand import DEFAULT_TRAFFIC, density_named
from pavetwin.uav.aircraft import AIRCRAFT

PRESET: Final = "default"

USUAL_COUNT: Final = 8
"""Segments that are inspected unless they are chosen."""

_MOST_SEGMENTS: Final = 2000
_LARGEST_SEED: Final = 2**32 - 1

SegmentName = Annotated[str, StringConstraints(max_length=200)]
Label = Annotated[str, StringConstraints(max_length=40, pattern=re.compile(r"^[\w.+-]+$"))]


class FlightRequest(Settings):
    """A mission, or missions under several policies over the same traffic."""

    segments: Annotated[tuple[SegmentName, ...], Field(max_length=_MOST_SEGMENTS)] = ()
    """Ids of the segments, in order; none: `count` of them are drawn."""
    count: Annotated[int, Field(ge=1, le=_MOST_SEGMENTS)] | None = USUAL_COUNT
    """None: all that can be reached."""
    order: Label = "random"
    altitude_m: float = 10.0
    policies: Annotated[tuple[Label, ...], Field(min_length=1, max_length=20)] = ("hover",)
    traffic: Label | None = None
    """Level of service, hour or density by name, as in `los-C`, `hour-08` and `high`; the usual one unless given."""
    mix: Label | None = None
    sensor: Label | None = None
    aircraft: Label | None = None
    seed: Annotated[int, Field(ge=0, le=_LARGEST_SEED)] = 0
    date: Label | None = None
    time: Annotated[str, StringConstraints(max_length=8, pattern=re.compile(r"^[0-9:]+$"))] | None = None
    clouds: float | None = None
    wind_mps: float | None = None
    wind_from_deg: float | None = None

    @classmethod
    def of(cls, values: Any) -> Self:
        """Raises:
        PaveTwinError: a value does not fit, or a name is not registered.
        """
        if not isinstance(values, dict):
            raise PaveTwinError("the page: a request is an object with the keys of a mission.")
        request = cls.parse(values, where="the page")
        request.settings()
        density_named(request.traffic or DEFAULT_TRAFFIC, request.mix or "")
        return request

    @field_validator("policies")
    @classmethod
    def _registered_policies(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        for name in names:
            if name != ALL:
                _check("policy", name, policy_names())
        return names

    @model_validator(mode="after")
    def _registered(self) -> Self:
        if self.sensor is not None:
            _check("sensor", self.sensor, sensor_names())
        if self.aircraft is not None:
            _check("aircraft", self.aircraft, AIRCRAFT.names())
        return self

    @property
    def names(self) -> list[str]:
        """Names of the policies, each once."""
        return policies_named(self.policies)

    @property
    def density(self) -> str | None:
        """The name of the traffic with its mix; None for the usual one, or the nearest to it that the world reaches."""
        if self.traffic is None:
            return None
        return density_named(self.traffic, self.mix or "").name

    @property
    def is_usual(self) -> bool:
        """Whether the targets follow from the seed alone."""
        return not self.segments and self.order == "random" and self.count == USUAL_COUNT

    def settings(self) -> MissionSettings:
        """Raises:
        PaveTwinError: a value does not fit.
        """
        check_altitude(self.altitude_m)
        given: dict[str, Any] = {"altitude_m": self.altitude_m}
        if self.sensor is not None:
            given["sensing"] = {"sensor": self.sensor}
        if self.aircraft is not None:
            given["aircraft"] = self.aircraft
        names = ("date", "time", "clouds", "wind_mps", "wind_from_deg")
        conditions = {name: value for name in names if (value := getattr(self, name)) is not None}
        if conditions:
            given["conditions"] = conditions
        return load_settings(PRESET, (), **given)


def _check(what: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise ValueError(no_such(what, name, known, key=f"`{what}`").rstrip("."))
