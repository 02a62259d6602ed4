"""The light over a scene: the sun's position, and sun and sky as numbers that any renderer can use."""

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Final, Self

import numpy as np
import numpy.typing as npt
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.config import Conditions
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
    """Elevation of the sun over the middle of a world when a mission begins; negative below the horizon."""
    longitude, latitude = centre_lonlat(world)
    return sun_position(conditions.utc(longitude), latitude_deg=latitude, longitude_deg=longitude)[0]


LUMINANCE: Final = np.array([0.2126, 0.7152, 0.0722])
"""Luminance weights of linear sRGB (IEC 61966-2-1)."""

SUN_RADIUS_RAD: Final = math.radians(0.533 / 2)
"""The sun's mean angular radius."""

_SOLAR_KLUX: Final = 127.5  # Illuminance of the sun above the atmosphere (IES)
# IES: extinction c of the sun's beam, then A, B and C of the sky's horizontal illuminance A + B·sin(elevation)^C in
# kilolux, for a clear, a partly cloudy and a cloudy sky.
_CLOUD_COVERS: Final = (0.0, 0.5, 1.0)
_IES: Final = ((0.21, 0.8, 15.5, 0.5), (0.80, 0.3, 45.0, 1.0), (math.inf, 0.3, 21.0, 1.0))

# CIE standard general sky: gradation a, b and indicatrix c, d, e of types 12 (clear, low turbidity) and 1 (overcast).
_CLEAR_SKY: Final = (-1.0, -0.32, 10.0, -3.0, 0.45)
_OVERCAST_SKY: Final = (4.0, -0.70, 0.0, -1.0, 0.0)

# Preetham: Perez coefficients of the chromaticities x and y, each a line in turbidity, and their zenith values.
_PEREZ_X: Final = ((-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452))
_PEREZ_Y: Final = ((-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529))
_ZENITH_X: Final = (
    (0.00166, -0.00375, 0.00209, 0.0),
    (-0.02903, 0.06377, -0.03202, 0.00394),
    (0.11693, -0.21196, 0.06052, 0.25886),
)
_ZENITH_Y: Final = (
    (0.00275, -0.00610, 0.00317, 0.0),
    (-0.04214, 0.08970, -0.04153, 0.00516),
    (0.15346, -0.26756, 0.06670, 0.26688),
)

# XYZ to linear sRGB (IEC 61966-2-1).
_TO_RGB: Final = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])

# Preetham's clear skies are bluer than measured ones, which haze whitens (Kider et al., A Framework for the
# Experimental Comparison of Solar and Skydome Illumination, SIGGRAPH Asia 2014).
_CHROMA: Final = 0.7

# Representative wavelengths of the three primaries, micrometres.
_WAVELENGTHS_UM: Final = np.array([0.610, 0.550, 0.465])

# Of clouds and of the sun above the atmosphere, in linear sRGB of luminance 1: 6500 K and about 5800 K.
_CLOUD_RGB: Final = np.array([1.0, 1.0, 1.0])
_SUN_RGB: Final = np.array([1.065, 0.985, 0.945])


@dataclass(frozen=True)
class Light:
    """The light at one time. Derived values are computed on first use."""

    sun_elevation_deg: float
    sun_azimuth_deg: float
    """Clockwise from north."""
    cloud_cover: float = 0.0
    """0 clear, 0.5 partly cloudy (a veiled sun), 1 overcast (no sun)."""
    turbidity: float = 3.0
    """Preetham's: 2 very clear, 3 clear, 6 hazy."""
    visibility_m: float = 12_000.0
    """At which distance haze leaves a contrast of 2 % (Koschmieder)."""
    enclosure: float = 0.3
    """Share of the sky that houses and trees hide from a street, replaced by light that they reflect."""

    def __post_init__(self) -> None:
        if not 0 < self.sun_elevation_deg <= 90:
            raise ValueError(f"the sun stands {self.sun_elevation_deg}° high; a light needs it above the horizon")
        if not 0 <= self.cloud_cover <= 1:
            raise ValueError(f"a cloud cover lies between 0 and 1, not at {self.cloud_cover}")
        if not 1.7 <= self.turbidity <= 10:
            raise ValueError(f"a turbidity lies between 1.7 and 10, not at {self.turbidity}")
        if self.visibility_m <= 0:
            raise ValueError("a visibility is a positive distance")

    @classmethod
    def of(cls, conditions: Conditions, *, latitude_deg: float, longitude_deg: float) -> Self:
        """The light of a date, time and weather at a place.

        Raises:
            PaveTwinError: the sun is below the horizon.
        """
        when = conditions.utc(longitude_deg)
        elevation, azimuth = sun_position(when, latitude_deg=latitude_deg, longitude_deg=longitude_deg)
        if elevation <= 0:
            raise PaveTwinError(
                f"`time` {conditions.time:%H:%M}: on {conditions.date} the sun is then {-elevation:.1f}° below the "
                f"horizon at latitude {latitude_deg:.2f}°; choose another time of day."
            )
        return cls(elevation, azimuth, conditions.clouds, conditions.turbidity)

    @property
    def haze_m(self) -> float:
        """The distance at which haze leaves 1/e of a contrast."""
        return self.visibility_m / math.log(50)

    @cached_property
    def to_sun(self) -> Float64Array:
        """(3,) unit vector towards the sun."""
        elevation, azimuth = math.radians(self.sun_elevation_deg), math.radians(self.sun_azimuth_deg)
        flat = math.cos(elevation)
        return np.array([flat * math.sin(azimuth), flat * math.cos(azimuth), math.sin(elevation)])

    @cached_property
    def sun_klux(self) -> Float64Array:
        """(3,) linear RGB: illuminance on a surface that faces the sun."""
        height = math.sin(math.radians(self.sun_elevation_deg))
        beams = [_SOLAR_KLUX * math.exp(-extinction / height) for extinction, *_ in _IES]
        klux = float(np.interp(self.cloud_cover, _CLOUD_COVERS, beams))
        # Kasten and Young 1989, the air mass; Rayleigh and aerosol depths as Preetham has them (appendix A.1).
        mass = 1 / (height + 0.50572 * (self.sun_elevation_deg + 6.07995) ** -1.6364)
        haze = 0.04608 * self.turbidity - 0.04586
        depth = 0.008735 * _WAVELENGTHS_UM**-4.08 + haze * _WAVELENGTHS_UM**-1.3
        colour = _SUN_RGB * np.exp(-depth * mass)
        return np.asarray(colour / (LUMINANCE @ colour) * klux)

    @cached_property
    def sky_klux(self) -> float:
        """Illuminance of level ground by the sky only."""
        height = math.sin(math.radians(self.sun_elevation_deg))
        skies = [a + b * height**c for _, a, b, c in _IES]
        return float(np.interp(self.cloud_cover, _CLOUD_COVERS, skies))

    def sky(self, directions: npt.ArrayLike) -> Float64Array:
        """Luminance of the sky in directions (..., 3) of any length: (..., 3) linear RGB, the sun itself left out.

        Below the horizon it continues as at the horizon.
        """
        both = self._two_skies(np.asarray(directions, dtype=np.float64))
        return np.asarray(np.einsum("k...c,k->...c", both, self._shares))

    def _two_skies(self, directions: Float64Array) -> Float64Array:
        """(2, ..., 3) the clear and the overcast sky, over their luminance in the zenith."""
        towards = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        up = np.clip(towards[..., 2], 0.01, 1)
        apart = np.arccos(np.clip(towards @ self.to_sun, -1, 1))
        sun_zenith = math.pi / 2 - math.radians(self.sun_elevation_deg)
        clear = _relative(up, apart, sun_zenith, _CLEAR_SKY)[..., None] * self._clear_colour(up, apart, sun_zenith)
        overcast = _relative(up, apart, sun_zenith, _OVERCAST_SKY)[..., None] * _CLOUD_RGB
        return np.stack([clear, overcast])

    @cached_property
    def _shares(self) -> Float64Array:
        """(2,) factors of the two skies, so that each gives level ground its share of `sky_klux`."""
        directions, weights = _upper_half()
        klux = np.einsum("knc,c,n->k", self._two_skies(directions), LUMINANCE, directions[:, 2] * weights)
        return np.asarray(np.array([1 - self.cloud_cover, self.cloud_cover]) * self.sky_klux / klux)

    def _clear_colour(self, up: Float64Array, apart: Float64Array, sun_zenith: float) -> Float64Array:
        """Linear RGB of luminance 1."""
        xy = []
        for lines, zenith in ((_PEREZ_X, _ZENITH_X), (_PEREZ_Y, _ZENITH_Y)):
            a, b, c, d, e = (slope * self.turbidity + start for slope, start in lines)
            powers = np.array([self.turbidity**2, self.turbidity, 1])
            angles = np.array([sun_zenith**3, sun_zenith**2, sun_zenith, 1])
            at_zenith = float(powers @ np.array(zenith) @ angles)
            xy.append(at_zenith * _relative(up, apart, sun_zenith, (a, b, c, d, e), preetham=True))
        x, y = xy
        rgb = np.clip(np.stack([x / y, np.ones_like(x), (1 - x - y) / y], axis=-1) @ _TO_RGB.T, 0, None)
        rgb /= (rgb @ LUMINANCE)[..., None]
        return np.asarray(1 + _CHROMA * (rgb - 1))

    @cached_property
    def sky_irradiance(self) -> Float64Array:
        """(9, 3): irradiance in klux of sky, houses and lit ground, without the sun, as spherical harmonics of order 2.

        Evaluated by Σ cᵢ Yᵢ(n) with the real, normalised harmonics of `harmonics` (Ramamoorthi and Hanrahan 2001).
        """
        directions, weights = _upper_half()
        ground, walls = self.ground_radiance, self.wall_radiance
        upper = (1 - self.enclosure) * self.sky(directions) + self.enclosure * walls
        moments = np.einsum("ni,nc,n->ic", harmonics(directions), upper, weights)
        below = directions * np.array([1.0, 1.0, -1.0])
        moments += np.einsum("ni,c,n->ic", harmonics(below), ground, weights)
        bands = np.array([math.pi] + [2 * math.pi / 3] * 3 + [math.pi / 4] * 5)
        return np.asarray(moments * bands[:, None])

    @cached_property
    def wall_radiance(self) -> Float64Array:
        """(3,) luminance of façades and crowns around a street: reflectance 0.33, half of them in the sun."""
        reflectance = np.array([0.36, 0.33, 0.28])
        flat = math.cos(math.radians(self.sun_elevation_deg))
        sun = self.sun_klux * flat / math.pi
        directions, weights = _upper_half()
        sky = np.einsum("nc,n,n->c", self.sky(directions), directions[..., 2], weights) / 2
        return np.asarray(reflectance / math.pi * (sun / 2 + sky + math.pi / 2 * self.ground_radiance))

    @cached_property
    def ground_radiance(self) -> Float64Array:
        """(3,) luminance of the surrounding ground, as reflected by walls and car doors: pavement and some green,
        0.16."""
        reflectance = np.array([0.165, 0.16, 0.145])
        directions, weights = _upper_half()
        sky = np.einsum("nc,n,n->c", self.sky(directions), directions[..., 2], weights)
        return np.asarray(reflectance / math.pi * (self.sun_klux * self.to_sun[2] + sky))


def harmonics(directions: npt.ArrayLike) -> Float64Array:
    """The nine real spherical harmonics up to order 2 in unit directions (..., 3): (..., 9)."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    flat = 0.282095 * np.ones_like(x)
    first = [0.488603 * y, 0.488603 * z, 0.488603 * x]
    second = [1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z]
    return np.stack([flat, *first, *second, 0.546274 * (x * x - y * y)], axis=-1)


def _relative(
    up: Float64Array,
    apart: Float64Array,
    sun_zenith: float,
    terms: tuple[float, float, float, float, float],
    *,
    preetham: bool = False,
) -> Float64Array:
    """Luminance over the zenith's: gradation (a, b) by the cosine from the zenith, indicatrix (c, d, e) by the angle
    from the sun. The CIE has exp(dχ) − exp(dπ/2) in its indicatrix where Perez has exp(dχ)."""
    a, b, c, d, e = terms
    offset = 0.0 if preetham else math.exp(d * math.pi / 2)
    here = (1 + a * np.exp(b / up)) * (1 + c * (np.exp(d * apart) - offset) + e * np.cos(apart) ** 2)
    zenith = (1 + a * math.exp(b)) * (1 + c * (math.exp(d * sun_zenith) - offset) + e * math.cos(sun_zenith) ** 2)
    return np.asarray(here / zenith)


def _upper_half() -> tuple[Float64Array, Float64Array]:
    """Directions (n, 3) over the upper half sphere and the solid angle each stands for (n,)."""
    rows, columns = 24, 72
    up = (np.arange(rows) + 0.5) / rows
    around = (np.arange(columns) + 0.5) / columns * 2 * math.pi
    height, turn = np.meshgrid(up, around, indexing="ij")
    flat = np.sqrt(1 - height**2)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1).reshape(-1, 3)
    return directions, np.full(len(directions), 2 * math.pi / len(directions))
