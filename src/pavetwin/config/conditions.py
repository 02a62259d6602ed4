"""Time and weather of a mission or an image. The place is that of the world.

Light (`pavetwin.scene.light`) and wind (the kernel's airspeed) are read from here. To model further weather, add a
field here and compute its effect in a module of its own.
"""

import datetime as dt
from collections.abc import Callable
from math import cos, radians, sin
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field

from pavetwin.config.settings import Settings

FIRST_YEAR: Final = 1950
LAST_YEAR: Final = 2050
"""Within these the sun's position is known to 0.02°, see `pavetwin.scene.light`."""


def _read_date(value: Any) -> dt.date:
    day = _parsed(value, dt.date.fromisoformat)
    if not isinstance(day, dt.date) or isinstance(day, dt.datetime):
        raise ValueError("expected a date of the calendar, such as 2026-06-21")
    if not FIRST_YEAR <= day.year <= LAST_YEAR:
        raise ValueError(f"expected a date from {FIRST_YEAR} to {LAST_YEAR}")
    return day


def _read_time(value: Any) -> dt.time:
    clock = _parsed(value, dt.time.fromisoformat)
    if not isinstance(clock, dt.time) or clock.tzinfo is not None or (isinstance(value, str) and ":" not in value):
        raise ValueError("expected a time of day without a time zone, such as 09:30")
    return clock


def _parsed(value: Any, parse: Callable[[str], Any]) -> Any:
    """A text parsed by `parse`, None if that fails; other values unchanged."""
    try:
        return parse(value) if isinstance(value, str) else value
    except ValueError:
        return None


class Conditions(Settings):
    """The outer conditions of a mission or an image. Flight, energy, frames and datasets read the same value."""

    date: Annotated[dt.date, BeforeValidator(_read_date)] = dt.date(2025, 3, 20)
    """Date, 1950 to 2050."""
    time: Annotated[dt.time, BeforeValidator(_read_time)] = dt.time(10)
    """Mean solar time at the world's base at take-off: UTC plus 1 h per 15° of longitude east."""
    clouds: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Cloud cover: 0 clear, 1 overcast."""
    turbidity: Annotated[float, Field(ge=1.7, le=10)] = 3.0
    """Turbidity after Preetham: 2 very clear, 6 hazy."""
    wind_mps: Annotated[float, Field(ge=0)] = 0.0
    """Mean wind speed at flight altitude."""
    wind_from_deg: Annotated[float, Field(ge=0, lt=360)] = 270.0
    """Direction the wind comes from, clockwise from north."""
    gust_factor: Annotated[float, Field(ge=1, le=3)] = 1.0
    """Gust speed over mean wind speed: 1 without gusts, 1.5 is usual above built-up ground."""
    temperature_c: Annotated[float, Field(ge=-30, le=50)] = 20.0
    """Temperature of the batteries at take-off."""

    def utc(self, longitude_deg: float) -> dt.datetime:
        """The date and time in UTC at a longitude, east positive."""
        return dt.datetime.combine(self.date, self.time, dt.UTC) - solar_offset(longitude_deg)

    @property
    def gust_mps(self) -> float:
        """Highest speed of the wind, gusts included."""
        return self.wind_mps * self.gust_factor

    @property
    def wind_velocity_mps(self) -> tuple[float, float]:
        """Velocity of the air over the ground: east and north."""
        towards = radians(270 - self.wind_from_deg)
        return self.wind_mps * cos(towards), self.wind_mps * sin(towards)


def solar_offset(longitude_deg: float) -> dt.timedelta:
    """Mean solar time at a longitude (east positive) minus UTC."""
    return dt.timedelta(hours=longitude_deg / 15)
