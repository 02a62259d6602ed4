"""The conditions of one image: a day of the year, a time with the sun up, and clouds; and the light that follows."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final, Self

import numpy as np

from pavetwin.config import Conditions
from pavetwin.config.conditions import solar_offset
from pavetwin.scene.light import Light, centre_lonlat, sun_position
from pavetwin.world.model import World

LEAST_ELEVATION_DEG: Final = 12.0
"""Least elevation of the sun: below it shadows are five times as long as their casters, and pavement is not
inspected."""

YEAR: Final = 2025  # Year of the images' dates

_SKIES: Final = ((0.45, 0.0, 0.2), (0.35, 0.2, 0.7), (0.20, 0.7, 1.0))
"""Share of images, and the cloud cover they are drawn from: mostly clear, partly cloudy, overcast. Ours; there is no
one mix of weather in which roads are inspected."""

_TURBIDITY: Final = (2.2, 5.0)  # From very clear to hazy


COMPENSATION_SD_EV, MOST_COMPENSATION_EV = 0.4, 1.0
"""Standard deviation of exposures around the metered one, in stops: the photographs of RDD2022's China drone subset
have lightnesses L* of 49 to 72 in the middle 80 %, which is about one stop to either side."""


@dataclass(frozen=True)
class Daylight:
    """The conditions of an image at a place: their moment and light, and how the exposure follows them."""

    when: datetime
    """UTC."""
    light: Light
    compensation_ev: float = 0.0
    """Added to the camera's own exposure, in stops."""

    @classmethod
    def of(cls, conditions: Conditions, world: World, compensation_ev: float = 0.0) -> Self:
        """Over the middle of a world: the sun is the same all over it.

        Raises:
            PaveTwinError: the sun is below the horizon.
        """
        longitude, latitude = centre_lonlat(world)
        light = Light.of(conditions, latitude_deg=latitude, longitude_deg=longitude)
        return cls(conditions.utc(longitude), light, compensation_ev)

    def as_dict(self) -> dict[str, Any]:
        return {
            "utc": self.when.isoformat(timespec="seconds").replace("+00:00", "Z"),
            "sun_elevation_deg": round(self.light.sun_elevation_deg, 2),
            "sun_azimuth_deg": round(self.light.sun_azimuth_deg, 2),
            "cloud_cover": self.light.cloud_cover,
            "turbidity": self.light.turbidity,
            "exposure_compensation_ev": self.compensation_ev,
        }


def draw_conditions(rng: np.random.Generator, longitude_deg: float, latitude_deg: float) -> Conditions:
    """Any day of the year, any time of it with the sun at least 12° up, and any of three kinds of sky."""
    offset = solar_offset(longitude_deg)
    noon = datetime(YEAR, 1, 1, 12, tzinfo=UTC) - offset
    while True:
        hours = 24.0 * int(rng.integers(365)) + float(rng.uniform(-9.0, 9.0))
        when = (noon + timedelta(hours=hours)).replace(microsecond=0)
        elevation, _ = sun_position(when, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
        if elevation >= LEAST_ELEVATION_DEG:
            break
    _, low, high = _SKIES[int(rng.choice(len(_SKIES), p=[share for share, _, _ in _SKIES]))]
    clouds = round(float(rng.uniform(low, high)), 3)
    turbidity = round(float(rng.uniform(*_TURBIDITY)), 2)
    solar = when + offset
    return Conditions(date=solar.date(), time=solar.time(), clouds=clouds, turbidity=turbidity)


def draw_compensation_ev(rng: np.random.Generator) -> float:
    """Random exposure compensation of an image, in stops."""
    stops = COMPENSATION_SD_EV * float(rng.standard_normal())
    return round(min(max(stops, -MOST_COMPENSATION_EV), MOST_COMPENSATION_EV), 2)
