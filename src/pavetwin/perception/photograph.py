"""The pose of a photograph from its EXIF and DJI's XMP tags, and the size and place of its pixels on the ground.

The ground is assumed to be a plane at the height of the take-off, and the camera to be level (no roll).
"""

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Final

import numpy as np
from PIL import ExifTags, Image

from pavetwin.arrays import Float64Array
from pavetwin.perception.drone_tags import (
    SOFTWARE,
    LonLat,
    above_sea_m_in,
    dji_tags,
    focal_px_in,
    lonlat_in,
    number_in,
    position_error_m_in,
)
from pavetwin.world.georeference import ELLIPSOID

MOST_TILT_DEG: Final = 30.0
"""Tilt from straight down up to which sizes are given; our assumption."""

FARTHEST: Final = 10.0
"""Distance on the ground, as a multiple of the height, up to which places are given; our assumption."""

SAME_HEIGHT_M: Final = 0.5
"""Heights above the ground and above the sea that differ by no more are the same; our assumption."""


@dataclass(frozen=True, slots=True)
class PhotographPose:
    """Place and direction of the camera; None for values that the photograph does not state."""

    size_px: tuple[int, int]
    """Width and height."""
    lonlat: LonLat | None = None
    height_m: float | None = None
    """Height above the ground of the take-off."""
    heading_deg: float | None = None
    """Direction of the view, or of the image's upper edge for a view straight down; clockwise from north."""
    pitch_deg: float | None = None
    """−90 straight down, 0 level."""
    focal_px: float | None = None
    position_error_m: float | None = None
    """Standard deviation of the position, east and north each, where the receiver states it."""
    above_sea_m: float | None = None
    """Height above the sea."""
    is_turned: bool = False
    """Whether EXIF states that it is stored turned or mirrored: the direction of the camera's upper edge is then not
    known, and its view is left out."""

    @property
    def is_nadir(self) -> bool:
        """Whether it looks steeply enough down for sizes."""
        return self.pitch_deg is not None and abs(self.pitch_deg + 90.0) <= MOST_TILT_DEG

    @property
    def is_height_above_sea(self) -> bool:
        """Whether the height above the ground equals that above the sea: the ground is at sea level, or the height is
        wrong."""
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
    """The pose of an open Pillow image. Damaged tags count as missing."""
    try:
        return _pose(image)
    # Pillow's readers of tags raise nearly anything for damaged ones.
    except Exception:
        return PhotographPose(image.size)


def _pose(image: Image.Image) -> PhotographPose:
    exif, dji = image.getexif(), dji_tags(image)
    turned = exif.get(ExifTags.Base.Orientation, 1) in (5, 6, 7, 8)
    size = (image.height, image.width) if turned else image.size
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    if exif.get(ExifTags.Base.Orientation, 1) != 1:
        return PhotographPose(size, lonlat_in(gps, dji), is_turned=True)
    heading, pitch = dji.get("GimbalYawDegree"), dji.get("GimbalPitchDegree")
    return PhotographPose(
        size,
        lonlat_in(gps, dji),
        dji.get("RelativeAltitude"),
        heading if heading is not None else number_in(gps.get(ExifTags.GPS.GPSImgDirection)),
        pitch,
        focal_px_in(exif.get_ifd(ExifTags.IFD.Exif), size),
        position_error_m_in(gps, dji),
        None if exif.get(ExifTags.Base.Software) == SOFTWARE else above_sea_m_in(gps, dji),
    )
