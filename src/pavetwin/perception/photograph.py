"""What a photograph says of how it was taken, in EXIF and in the XMP tags of DJI's cameras, and what follows for the
ground: how large a pixel is, and where on the earth it lies.

The ground is taken as a plane at the height of the take-off, and the camera as held level (no roll).
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, hypot, isfinite, radians, sin
from typing import Any, Final

import numpy as np
from PIL import ExifTags, Image

from pavetwin.arrays import Float64Array
from pavetwin.world.georeference import ELLIPSOID

LonLat = tuple[float, float]
"""Longitude and latitude in degrees, WGS 84."""

MOST_TILT_DEG: Final = 30.0
"""From straight down, up to which sizes are given; our assumption."""

FARTHEST: Final = 10.0
"""Distance on the ground, as a multiple of the height, up to which places are given; our assumption."""

SAME_HEIGHT_M: Final = 0.5
"""Heights above the ground and above the sea that differ by no more are the same; our assumption."""

_OF_WORLDS: Final = "PaveTwin"
"""The software of rendered photographs, whose worlds lie at sea level."""

_FULL_FRAME_MM: Final = (36.0, 24.0)
"""Frame that 35 mm equivalent focal lengths refer to."""

_MM_OF_UNIT: Final = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""EXIF's units of `FocalPlaneResolutionUnit`."""


@dataclass(frozen=True, slots=True)
class PhotographPose:
    """Where a photograph was taken, and how the camera looked; None for what it does not say."""

    size_px: tuple[int, int]
    """Width and height."""
    lonlat: LonLat | None = None
    height_m: float | None = None
    """Above the ground of the take-off."""
    heading_deg: float | None = None
    """Of the view, or of the picture's upper edge where it looks straight down; clockwise from north."""
    pitch_deg: float | None = None
    """−90 straight down, 0 level."""
    focal_px: float | None = None
    position_error_m: float | None = None
    """Standard deviation of the position, east and north each, where the receiver states it."""
    above_sea_m: float | None = None
    """Height above the sea."""
    is_turned: bool = False
    """Whether EXIF says that it is stored turned or mirrored: where its camera's upper edge pointed is not known then,
    and its view is left out."""

    @property
    def is_nadir(self) -> bool:
        """Whether it looks near enough straight down for sizes."""
        return self.pitch_deg is not None and abs(self.pitch_deg + 90.0) <= MOST_TILT_DEG

    @property
    def is_height_above_sea(self) -> bool:
        """Whether the height above the ground is the one above the sea: the ground lies at sea level, or it is the
        wrong height."""
        heights = (self.height_m, self.above_sea_m)
        return None not in heights and abs(heights[0] - heights[1]) <= SAME_HEIGHT_M  # type: ignore[operator]

    def gsd_mm(self, x: float, y: float) -> float | None:
        """Side of a square on the ground as large as the pixel there, in mm; None where it is not known."""
        if not self.is_nadir:
            return None
        corners = self._ground(np.array([[x, y], [x + 1, y], [x, y + 1]]))
        if corners is None:
            return None
        (ax, ay), (bx, by) = corners[1] - corners[0], corners[2] - corners[0]
        return float(1000.0 * np.sqrt(abs(ax * by - ay * bx)))

    def lonlats(self, pixels: Float64Array) -> list[LonLat] | None:
        """Places of pixels (n, 2), column and row; None where they are not known, or one is above the horizon."""
        ground = self._ground(pixels)
        if ground is None or self.lonlat is None or self.heading_deg is None:
            return None
        distances = np.hypot(ground[:, 0], ground[:, 1])
        azimuths = np.degrees(np.arctan2(ground[:, 0], ground[:, 1]))
        count = len(pixels)
        lon, lat, _ = ELLIPSOID.fwd([self.lonlat[0]] * count, [self.lonlat[1]] * count, azimuths, distances)
        return [(round(float(x), 8), round(float(y), 8)) for x, y in zip(lon, lat, strict=True)]

    def pixels(self, lonlats: Float64Array) -> Float64Array | None:
        """Column and row (n, 2) of places on the ground, longitude and latitude (n, 2): the inverse of `lonlats`.

        Returns:
            None where the pose is not known, or one lies behind the camera.
        """
        if self.lonlat is None or self.height_m is None or self.height_m <= 0 or self.focal_px is None:
            return None
        if self.pitch_deg is None or self.heading_deg is None:
            return None
        count = len(lonlats)
        azimuths, _, distances = ELLIPSOID.inv(
            [self.lonlat[0]] * count, [self.lonlat[1]] * count, lonlats[:, 0].tolist(), lonlats[:, 1].tolist()
        )
        east, north = (np.array(distances) * side(np.radians(azimuths)) for side in (np.sin, np.cos))
        seen = np.column_stack([east, north, np.full(count, -self.height_m)]) @ self._axes(self.pitch_deg).T
        if (seen[:, 2] <= 0).any():
            return None
        pixels: Float64Array = self.focal_px * seen[:, :2] / seen[:, 2:] + np.array(self.size_px) / 2
        return pixels

    def _axes(self, pitch_deg: float) -> Float64Array:
        """(3, 3) The camera's right, down and ahead in east, north, up; a row each."""
        yaw, pitch = radians(self.heading_deg or 0.0), radians(pitch_deg)
        ahead = np.array([sin(yaw) * cos(pitch), cos(yaw) * cos(pitch), sin(pitch)])
        right = np.array([cos(yaw), -sin(yaw), 0.0])
        return np.stack([right, np.cross(ahead, right), ahead])

    def _ground(self, pixels: Float64Array) -> Float64Array | None:
        """East and north of the camera in metres, (n, 2)."""
        if self.height_m is None or self.focal_px is None or self.pitch_deg is None or self.height_m <= 0:
            return None
        rays = np.column_stack([pixels - np.array(self.size_px) / 2, np.full(len(pixels), self.focal_px)])
        rays = rays @ self._axes(self.pitch_deg)
        if (rays[:, 2] >= -1e-6).any():
            return None
        ground: Float64Array = rays[:, :2] * (self.height_m / -rays[:, 2:])
        return ground if np.hypot(ground[:, 0], ground[:, 1]).max() <= FARTHEST * self.height_m else None


def pose_of(image: Image.Image) -> PhotographPose:
    """What a picture that was opened by Pillow says. Damaged tags count as none."""
    try:
        return _pose(image)
    # Pillow's readers of tags raise nearly anything for damaged ones.
    except Exception:
        return PhotographPose(image.size)


def _pose(image: Image.Image) -> PhotographPose:
    exif, dji = image.getexif(), _dji(image)
    turned = exif.get(ExifTags.Base.Orientation, 1) in (5, 6, 7, 8)
    size = (image.height, image.width) if turned else image.size
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    if exif.get(ExifTags.Base.Orientation, 1) != 1:
        return PhotographPose(size, _lonlat(gps, dji), is_turned=True)
    heading, pitch = dji.get("GimbalYawDegree"), dji.get("GimbalPitchDegree")
    return PhotographPose(
        size,
        _lonlat(gps, dji),
        dji.get("RelativeAltitude"),
        heading if heading is not None else _number(gps.get(ExifTags.GPS.GPSImgDirection)),
        pitch,
        _focal_px(exif.get_ifd(ExifTags.IFD.Exif), size),
        _position_error_m(gps, dji),
        None if exif.get(ExifTags.Base.Software) == _OF_WORLDS else _above_sea_m(gps, dji),
    )


def _above_sea_m(gps: Mapping[int, Any], dji: Mapping[str, float]) -> float | None:
    if (stated := dji.get("AbsoluteAltitude")) is not None:
        return stated
    altitude = _number(gps.get(ExifTags.GPS.GPSAltitude))
    below = gps.get(ExifTags.GPS.GPSAltitudeRef) in (1, b"\x01")
    return -altitude if altitude is not None and below else altitude


def _position_error_m(gps: Mapping[int, Any], dji: Mapping[str, float]) -> float | None:
    """Of a receiver with corrections (DJI's RTK), or as EXIF's `GPSHPositioningError` states it."""
    stated = [dji[name] for name in ("RtkStdLon", "RtkStdLat") if name in dji]
    error = max(stated, default=_number(gps.get(ExifTags.GPS.GPSHPositioningError)))
    return error if error is not None and error >= 0 else None


def _dji(image: Image.Image) -> dict[str, float]:
    """Numbers of the XMP tags of DJI, which are attributes or elements."""
    told = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
    text = told.decode("utf-8", "replace") if isinstance(told, bytes) else str(told)
    found = re.findall(r"drone-dji:(\w+)(?:=\"|>)\s*([-+]?[0-9.]+)", text)
    numbers = ((name, _number(value)) for name, value in found)
    return {name: value for name, value in numbers if value is not None}


def _lonlat(gps: Mapping[int, Any], dji: Mapping[str, float]) -> LonLat | None:
    tag = ExifTags.GPS
    longitude = _degrees(gps.get(tag.GPSLongitude), gps.get(tag.GPSLongitudeRef), "W")
    latitude = _degrees(gps.get(tag.GPSLatitude), gps.get(tag.GPSLatitudeRef), "S")
    if longitude is None or latitude is None:
        longitude, latitude = dji.get("GpsLongitude"), dji.get("GpsLatitude")
    if longitude is None or latitude is None or abs(longitude) > 180 or abs(latitude) > 90:
        return None
    # Cameras without a fix write zeros.
    return None if longitude == latitude == 0.0 else (longitude, latitude)


def _degrees(angle: Any, reference: Any, negative: str) -> float | None:
    try:
        parts = [float(part) for part in angle]
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    value = sum(part / 60**at for at, part in enumerate(parts))
    return (-value if reference == negative else value) if isfinite(value) else None


def _focal_px(photo: Mapping[int, Any], size: tuple[int, int]) -> float | None:
    """From the sensor's resolution, which a smaller copy keeps with its first width, or from the 35 mm equivalent."""
    tag = ExifTags.Base
    focal_mm, density = _number(photo.get(tag.FocalLength)), _number(photo.get(tag.FocalPlaneXResolution))
    unit = _MM_OF_UNIT.get(photo.get(tag.FocalPlaneResolutionUnit, 2))
    if focal_mm and density and unit:
        return focal_mm * density / unit * size[0] / (_number(photo.get(tag.ExifImageWidth)) or size[0])
    in_35mm = _number(photo.get(tag.FocalLengthIn35mmFilm))
    return in_35mm * hypot(*size) / hypot(*_FULL_FRAME_MM) if in_35mm else None


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if isfinite(number) else None
