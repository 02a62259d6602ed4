"""Position of the sun: elevation and azimuth from date, time and place."""

import math
from datetime import UTC, datetime

import shapely

from pavetwin.config.conditions import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import World


def sun_position(when: datetime, *, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Elevation and azimuth (clockwise from north) of the sun in degrees, refraction left out.

    The low-precision solar coordinates of Meeus, Astronomical Algorithms (2nd ed. 1998), chapter 25, as NOAA's solar
    calculator uses them; within about 0.02° from 1950 to 2050.

    Raises:
        PaveTwinError: `when` names no time zone, or the latitude is none.
    """
    if when.tzinfo is None:
        raise PaveTwinError(f"the sun's position needs a time zone with {when.isoformat()}; for UTC add +00:00")
    if not -90 <= latitude_deg <= 90:
        raise PaveTwinError(f"a latitude lies between -90° and 90°, not at {latitude_deg}°")
    days = (when - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds() / 86400
    century = days / 36525
    mean_longitude = math.radians(280.46646 + 36000.76983 * century)
    anomaly = math.radians(357.52911 + 35999.05029 * century)
    centre = math.radians(
        (1.914602 - 0.004817 * century) * math.sin(anomaly)
        + 0.019993 * math.sin(2 * anomaly)
        + 0.000289 * math.sin(3 * anomaly)
    )
    node = math.radians(125.04 - 1934.136 * century)
    longitude = mean_longitude + centre - math.radians(0.00569 + 0.00478 * math.sin(node))
    obliquity = math.radians(23.439291 - 0.013004 * century + 0.00256 * math.cos(node))
    ascension = math.atan2(math.cos(obliquity) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(obliquity) * math.sin(longitude))
    sidereal = math.radians(280.46061837 + 360.98564736629 * days + longitude_deg)
    hour = sidereal - ascension
    latitude = math.radians(latitude_deg)
    elevation = math.asin(
        math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    )
    azimuth = math.atan2(
        -math.sin(hour) * math.cos(declination),
        math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(hour),
    )
    return math.degrees(elevation), math.degrees(azimuth) % 360


def centre_lonlat(world: World) -> tuple[float, float]:
    """Longitude and latitude of the middle of a world's segments in degrees, east and north positive.

    Not of its base, which missions choose: two missions at one time have the same light.
    """
    west, south, east, north = shapely.total_bounds([segment.polygon for segment in world.segments])
    longitude, latitude = world.georeference.to_wgs84(((west + east) / 2, (south + north) / 2))
    return float(longitude), float(latitude)


def sun_elevation_deg(conditions: Conditions, world: World) -> float:
    """Of the sun over the middle of a world when a mission begins; negative below the horizon."""
    longitude, latitude = centre_lonlat(world)
    return sun_position(conditions.utc(longitude), latitude_deg=latitude, longitude_deg=longitude)[0]
