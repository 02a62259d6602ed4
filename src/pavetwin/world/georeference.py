"""Georeferences, and that of a network: from SUMO's `<location>`, or from an anchor given by the user."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import CRSError

from pavetwin.arrays import Float64Array
from pavetwin.errors import PaveTwinError

DEFAULT_ANCHOR_DEG = (0.0, 0.0)
"""(latitude, longitude) in degrees of the origin of a network without a location: the Gulf of Guinea."""

WGS84 = 4326

SOUTHERNMOST_DEG, NORTHERNMOST_DEG = -80.0, 84.0
"""Latitudes that UTM reaches to."""

ELLIPSOID: Final = Geod(ellps="WGS84")
"""Ellipsoid for distances and directions between places in degrees."""


@dataclass(frozen=True, slots=True)
class GeoReference:
    """Position of the world frame on the earth: projected = world + offset, in the CRS `epsg` (a UTM zone)."""

    epsg: int
    offset_east_m: float
    offset_north_m: float

    def to_projected(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) in metres to projected (..., 2) in metres."""
        return np.asarray(xy, dtype=np.float64) + (self.offset_east_m, self.offset_north_m)

    def to_wgs84(self, xy: npt.ArrayLike) -> Float64Array:
        """World (..., 2) in metres to (longitude, latitude) (..., 2) in degrees."""
        projected = self.to_projected(xy)
        transformer = Transformer.from_crs(self.epsg, WGS84, always_xy=True)
        lon, lat = transformer.transform(projected[..., 0], projected[..., 1])
        return np.stack([lon, lat], axis=-1)


def utm_epsg(latitude: float, longitude: float) -> int:
    """EPSG code of the UTM zone of a place (WGS 84, degrees); without the exceptions for Norway and Svalbard."""
    zone = min(60, int((longitude + 180.0) // 6.0) + 1)
    return (32600 if latitude >= 0 else 32700) + zone


def anchored(latitude: float, longitude: float) -> GeoReference:
    """The georeference of a network whose origin is at a place (degrees), its y axis along grid north.

    Raises:
        PaveTwinError: the place is not on the earth, or outside the range of UTM (80° S to 84° N).
    """
    if not (SOUTHERNMOST_DEG <= latitude <= NORTHERNMOST_DEG and -180.0 <= longitude <= 180.0):
        raise PaveTwinError(
            f"The anchor {latitude:g},{longitude:g} is not a place for a world: "
            "latitude must be -80 … 84 and longitude -180 … 180 degrees, as in 52.47,13.44."
        )
    epsg = utm_epsg(latitude, longitude)
    east, north = Transformer.from_crs(WGS84, epsg, always_xy=True).transform(longitude, latitude)
    return GeoReference(epsg, round(float(east), 2), round(float(north), 2))


def parse_anchor(text: str) -> tuple[float, float]:
    """(latitude, longitude) in degrees from `LAT,LON`.

    Raises:
        PaveTwinError: the text is not two numbers, or no place on the earth.
    """
    parts = text.split(",")
    try:
        latitude, longitude = (float(part) for part in parts)
    except ValueError:
        raise PaveTwinError(f"`anchor` {text}: expected LAT,LON in degrees, as in 52.47,13.44.") from None
    anchored(latitude, longitude)
    return latitude, longitude


def from_location(location: Mapping[str, str], where: str) -> GeoReference | None:
    """The georeference that a SUMO network's `<location>` states, or None when it has no projection.

    SUMO writes world = projected + netOffset, so the offset here is its negative.

    Raises:
        PaveTwinError: the projection has no EPSG code, or the offset is not a pair of numbers; `where` names the file.
    """
    projection = location.get("projParameter", "!")
    if projection in ("", "!", "-", "."):
        return None
    try:
        east, north = (float(part) for part in location.get("netOffset", "0,0").split(","))
        code = CRS.from_user_input(projection).to_epsg(min_confidence=70)
    except (ValueError, CRSError):
        code = None
    if code is None:
        raise PaveTwinError(
            f"'{where}' is projected by '{projection}', which has no EPSG code; "
            "give the location of its origin as `anchor` LAT,LON."
        )
    return GeoReference(code, -east, -north)


def from_wgs84(georeference: GeoReference, lonlat: npt.ArrayLike) -> Float64Array:
    """(longitude, latitude) (..., 2) in degrees to world (..., 2) in metres."""
    degrees = np.asarray(lonlat, dtype=np.float64)
    transformer = Transformer.from_crs(WGS84, georeference.epsg, always_xy=True)
    east, north = transformer.transform(degrees[..., 0], degrees[..., 1])
    offset = (georeference.offset_east_m, georeference.offset_north_m)
    return np.stack([np.asarray(east), np.asarray(north)], axis=-1) - offset
