"""The light of one image: a day of the year, an hour with the sun up, and clouds."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final

import numpy as np

from pavetwin.scene.light import Light
from pavetwin.scene.sun import sun_position

LEAST_ELEVATION_DEG: Final = 12.0
"""Nobody inspects pavement when shadows are five times as long as what casts them."""

YEAR: Final = 2025
"""Of the dates in the images."""

_SKIES: Final = ((0.45, 0.0, 0.2), (0.35, 0.2, 0.7), (0.20, 0.7, 1.0))
"""Share of images, and the cloud cover they are drawn from: mostly clear, partly cloudy, overcast. Ours; there is no
one mix of weather in which roads are inspected."""

_TURBIDITY: Final = (2.2, 5.0)
"""From very clear to hazy."""


COMPENSATION_SD_EV, MOST_COMPENSATION_EV = 0.4, 1.0
"""How exposures scatter around what is metered, in stops: the photographs of RDD2022's China drone subset have
lightnesses L* of 49 to 72 in the middle 80 %, which is about one stop to either side."""


@dataclass(frozen=True)
class Daylight:
    """A moment, its light, and how bright the photographer likes it."""

    when: datetime
    """UTC."""
    light: Light
    compensation_ev: float = 0.0
    """Of the camera's own exposure, in stops."""

    def as_dict(self) -> dict[str, Any]:
        return {
            "utc": self.when.isoformat(timespec="seconds").replace("+00:00", "Z"),
            "sun_elevation_deg": round(self.light.sun_elevation_deg, 2),
            "sun_azimuth_deg": round(self.light.sun_azimuth_deg, 2),
            "cloud_cover": self.light.cloud_cover,
            "turbidity": self.light.turbidity,
            "exposure_compensation_ev": self.compensation_ev,
        }


def draw_daylight(rng: np.random.Generator, longitude: float, latitude: float) -> Daylight:
    """Any day of the year, any time of it with the sun at least 12° up, any of three kinds of sky, and an exposure.

    Args:
        longitude: east positive, degrees.
        latitude: north positive, degrees.
    """
    noon = datetime(YEAR, 1, 1, 12, tzinfo=UTC) - timedelta(hours=longitude / 15)
    while True:
        hours = 24.0 * int(rng.integers(365)) + float(rng.uniform(-9.0, 9.0))
        when = (noon + timedelta(hours=hours)).replace(microsecond=0)
        elevation, azimuth = sun_position(when, latitude_deg=latitude, longitude_deg=longitude)
        if elevation >= LEAST_ELEVATION_DEG:
            break
    _, low, high = _SKIES[int(rng.choice(len(_SKIES), p=[share for share, _, _ in _SKIES]))]
    cloud = round(float(rng.uniform(low, high)), 3)
    turbidity = round(float(rng.uniform(*_TURBIDITY)), 2)
    stops = COMPENSATION_SD_EV * float(rng.standard_normal())
    compensation = round(min(max(stops, -MOST_COMPENSATION_EV), MOST_COMPENSATION_EV), 2)
    return Daylight(when, Light(elevation, azimuth, cloud, turbidity), compensation)
