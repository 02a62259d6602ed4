"""Camera, pose, time and exposure of a rendered image, for its file and its record."""

from dataclasses import dataclass
from datetime import datetime
from math import cos, degrees, radians, sin
from typing import Any

import numpy as np

from pavetwin.capture.image_spec import image_gsd_mm
from pavetwin.capture.platforms import Pose
from pavetwin.perception.drone_tags import ExposureTags, PhotographTags
from pavetwin.render.frame import Exposure
from pavetwin.world.georeference import GeoReference


@dataclass(frozen=True)
class ImageMetadata:
    """Camera, pose, time and exposure of one image."""

    pose: Pose
    place: GeoReference
    when: datetime
    """UTC."""
    exposure: Exposure | None
    """None if the camera's settings are unknown."""
    is_airborne: bool

    @property
    def lonlat(self) -> tuple[float, float]:
        longitude, latitude = self.place.to_wgs84(self.pose.view.position[:2])
        return float(longitude), float(latitude)

    @property
    def heading_deg(self) -> float:
        """Clockwise from true north; corrected for the grid's meridian convergence."""
        ahead = self.pose.view.position[:2] + 100.0 * np.array([cos(self.pose.yaw_rad), sin(self.pose.yaw_rad)])
        (lon0, lat0), (lon1, lat1) = self.place.to_wgs84(np.stack([self.pose.view.position[:2], ahead]))
        east, north = (lon1 - lon0) * cos(radians(lat0)), lat1 - lat0
        return float(90.0 - degrees(np.arctan2(north, east))) % 360.0

    @property
    def sensor_mm(self) -> tuple[float, float]:
        """Width and height of the part of the sensor that the image shows: its whole height, or a crop."""
        view, focal_mm = self.pose.view, self.pose.camera.focal_mm
        return focal_mm * view.size_px[0] / view.focal_px, focal_mm * view.size_px[1] / view.focal_px

    @property
    def tags(self) -> PhotographTags:
        """Values for the tags of the image's file."""
        view, exposure = self.pose.view, self.exposure
        return PhotographTags(
            camera=self.pose.camera.title,
            focal_mm=self.pose.camera.focal_mm,
            sensor_mm=self.sensor_mm,
            size_px=view.size_px,
            lonlat=self.lonlat,
            altitude_m=float(view.position[2]),
            heading_deg=self.heading_deg,
            pitch_deg=degrees(self.pose.pitch_rad),
            when=self.when,
            exposure=None if exposure is None else ExposureTags(exposure.shutter_s, exposure.f_number, exposure.iso),
            is_airborne=self.is_airborne,
        )

    def as_dict(self) -> dict[str, Any]:
        """For the image's file: pose in the world frame and on the earth."""
        longitude, latitude = self.lonlat
        return {
            "model": self.pose.camera.title,
            "position_m": [round(float(value), 4) for value in self.pose.view.position],
            "rotation": [[round(float(value), 8) for value in row] for row in self.pose.view.rotation],
            "focal_px": round(self.pose.view.focal_px, 4),
            **self._crop,
            **self._resolution,
            "vertical_fov_deg": round(self.pose.camera.fov_deg, 4),
            "velocity_mps": [round(float(value), 3) for value in self.pose.view.velocity_mps],
            "longitude": round(longitude, 8),
            "latitude": round(latitude, 8),
            "altitude_m": round(float(self.pose.view.position[2]), 3),
            "heading_deg": round(self.heading_deg, 3),
            "pitch_deg": round(degrees(self.pose.pitch_rad), 3),
            "roll_deg": 0.0,
            **self._settings,
        }

    @property
    def _crop(self) -> dict[str, list[int]]:
        """Where a crop lies in the whole frame; its principal point is that frame's middle."""
        view = self.pose.view
        return {} if view.frame_px is None else {"frame_px": list(view.frame_px), "corner_px": list(view.corner_px)}

    @property
    def _resolution(self) -> dict[str, float | None]:
        return {"gsd_mm": image_gsd_mm(self.pose.view)} if self.is_airborne else {}

    @property
    def _settings(self) -> dict[str, float]:
        if self.exposure is None:
            return {}
        shutter = self.exposure.shutter_s
        return {
            "exposure_s": float(f"{shutter:.4g}"),
            "f_number": round(self.exposure.f_number, 2),
            "iso": round(self.exposure.iso),
        }
