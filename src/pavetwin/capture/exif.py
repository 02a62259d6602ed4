"""Where and how a picture was taken, inside the picture: EXIF, and for a UAV the XMP tags of DJI's cameras, which
photogrammetry programs read for the direction of view."""

import io
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import cos, degrees, hypot, radians, sin
from typing import Any, Final, Literal

import numpy as np
from PIL import ExifTags, Image, PngImagePlugin

from pavetwin.arrays import UInt8Array
from pavetwin.capture.image_spec import image_gsd_mm
from pavetwin.capture.platforms import Pose
from pavetwin.render.frame import Exposure
from pavetwin.world.georeference import GeoReference

_FULL_FRAME_MM: Final = (36.0, 24.0)
"""Frame of the film that 35 mm equivalent focal lengths refer to."""


@dataclass(frozen=True)
class ImageMetadata:
    """Camera, pose, time and exposure of one image."""

    pose: Pose
    place: GeoReference
    when: datetime
    """UTC."""
    exposure: Exposure | None
    """None where the camera's settings are not known."""
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


def encoded(rgb: UInt8Array, taken: ImageMetadata, *, picture: Literal["jpg", "png"], quality: int) -> bytes:
    """A picture (height, width, 3) as a file with its EXIF."""
    stream, image = io.BytesIO(), Image.fromarray(rgb)
    exif, xmp = _exif(taken), _xmp(taken) if taken.is_airborne else b""
    if picture == "jpg":
        # Colour at full resolution: the edge of a crack is a few pixels wide.
        image.save(stream, "JPEG", quality=quality, subsampling=0, exif=exif, xmp=xmp)
    else:
        info = PngImagePlugin.PngInfo()
        if xmp:
            info.add_itxt("XML:com.adobe.xmp", xmp.decode())
        image.save(stream, "PNG", exif=exif, pnginfo=info)
    return stream.getvalue()


def _exif(taken: ImageMetadata) -> Image.Exif:
    exif, longitude, local = Image.Exif(), taken.lonlat[0], _local(taken)
    maker, model = _maker_and_model(taken.pose.camera.title)
    tag, when = ExifTags.Base, local.strftime("%Y:%m:%d %H:%M:%S")
    exif.update({tag.Make: maker, tag.Model: model, tag.Software: "PaveTwin", tag.Orientation: 1})
    exif.update({tag.ImageDescription: "Synthetic image", tag.DateTime: when})
    width, height = taken.sensor_mm
    in_35mm = taken.pose.camera.focal_mm * hypot(*_FULL_FRAME_MM) / hypot(width, height)
    photo = exif.get_ifd(ExifTags.IFD.Exif)
    photo[tag.DateTimeOriginal] = when
    photo[tag.OffsetTimeOriginal] = f"{round(longitude / 15):+03d}:00"
    photo[tag.FocalLength] = round(taken.pose.camera.focal_mm, 3)
    photo[tag.FocalLengthIn35mmFilm] = round(in_35mm)
    photo[tag.FocalPlaneXResolution] = round(taken.pose.view.size_px[0] / width, 4)
    photo[tag.FocalPlaneYResolution] = round(taken.pose.view.size_px[1] / height, 4)
    photo[tag.FocalPlaneResolutionUnit] = 4  # a millimetre
    if taken.exposure is not None:
        photo[tag.ExposureTime] = taken.exposure.shutter_s
        photo[tag.FNumber] = round(taken.exposure.f_number, 2)
        photo[tag.ISOSpeedRatings] = round(taken.exposure.iso)
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(_gps(taken))
    return exif


def _maker_and_model(title: str) -> tuple[str, str]:
    """A camera's title begins with its maker's name; that of a fictitious camera does not."""
    maker, _, model = title.partition(" ")
    return ("PaveTwin", title) if maker == "Virtual" else (maker, model)


def _gps(taken: ImageMetadata) -> dict[int, Any]:
    tag, (longitude, latitude), when = ExifTags.GPS, taken.lonlat, taken.when
    return {
        tag.GPSVersionID: b"\x02\x03\x00\x00",
        tag.GPSLatitudeRef: "N" if latitude >= 0 else "S",
        tag.GPSLatitude: _sexagesimal(latitude),
        tag.GPSLongitudeRef: "E" if longitude >= 0 else "W",
        tag.GPSLongitude: _sexagesimal(longitude),
        tag.GPSAltitudeRef: b"\x00",
        tag.GPSAltitude: round(float(taken.pose.view.position[2]), 3),
        tag.GPSTimeStamp: (float(when.hour), float(when.minute), float(when.second)),
        tag.GPSImgDirectionRef: "T",
        tag.GPSImgDirection: round(taken.heading_deg, 3),
        tag.GPSMapDatum: "WGS-84",
        tag.GPSDateStamp: when.strftime("%Y:%m:%d"),
    }


def _sexagesimal(angle_deg: float) -> tuple[float, float, float]:
    """Degrees, minutes and seconds to a ten-thousandth, 3 mm on the ground."""
    seconds = round(abs(angle_deg) * 36_000_000) / 10_000
    return float(seconds // 3600), float(seconds // 60 % 60), round(seconds % 60, 4)


def _local(taken: ImageMetadata) -> datetime:
    """Local mean time by longitude, as no time zone is known."""
    return taken.when + timedelta(hours=round(taken.lonlat[0] / 15))


def _xmp(taken: ImageMetadata) -> bytes:
    """DJI's: angles in degrees, yaw clockwise from north, pitch −90 straight down."""
    longitude, latitude = taken.lonlat
    yaw = (taken.heading_deg + 180.0) % 360.0 - 180.0
    altitude = float(taken.pose.view.position[2])
    tags = {
        "AbsoluteAltitude": f"{altitude:+.2f}",
        "RelativeAltitude": f"{altitude:+.2f}",
        "GpsLatitude": f"{latitude:.8f}",
        "GpsLongitude": f"{longitude:.8f}",
        "GimbalRollDegree": "+0.00",
        "GimbalYawDegree": f"{yaw:+.2f}",
        "GimbalPitchDegree": f"{degrees(taken.pose.pitch_rad):+.2f}",
        "FlightRollDegree": "+0.00",
        "FlightYawDegree": f"{yaw:+.2f}",
        "FlightPitchDegree": "+0.00",
    }
    attributes = "\n".join(f'   drone-dji:{name}="{value}"' for name, value in tags.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '  <rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"\n'
        f"{attributes}/>\n </rdf:RDF>\n</x:xmpmeta>\n"
        '<?xpacket end="w"?>'
    ).encode()
