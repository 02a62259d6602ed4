"""EXIF and XMP tags of photographs: camera, place, time and direction of view.

They are written into rendered images, and read from any image. The XMP tags are those of DJI's drones, which
photogrammetry programs read.
"""

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import hypot, isfinite
from typing import Any, Final, Literal, NamedTuple

from PIL import ExifTags, Image, PngImagePlugin

from pavetwin.arrays import UInt8Array

LonLat = tuple[float, float]
"""Longitude and latitude in degrees, WGS 84."""

SOFTWARE: Final = "PaveTwin"
"""Software of rendered images, whose worlds lie at sea level."""

DJI: Final = "drone-dji"
"""XML prefix of DJI's tags."""

FULL_FRAME_MM: Final = (36.0, 24.0)
"""Frame of the film that 35 mm equivalent focal lengths refer to."""

MM_OF_UNIT: Final = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Units of EXIF's `FocalPlaneResolutionUnit`."""

MILLIMETRE: Final = 4
"""Key of a millimetre in `MM_OF_UNIT`."""


class ExposureTags(NamedTuple):
    """Settings of the camera."""

    shutter_s: float
    f_number: float
    iso: float


@dataclass(frozen=True)
class PhotographTags:
    """Values of the tags that `encoded` writes."""

    camera: str
    """Maker and model."""
    focal_mm: float
    sensor_mm: tuple[float, float]
    """Width and height of the part of the sensor in the image."""
    size_px: tuple[int, int]
    lonlat: LonLat
    altitude_m: float
    heading_deg: float
    """Clockwise from true north."""
    pitch_deg: float
    """−90 straight down, 0 level."""
    when: datetime
    """UTC."""
    exposure: ExposureTags | None
    """None if the camera's settings are unknown."""
    is_airborne: bool
    """Whether to write DJI's tags."""


def encoded(rgb: UInt8Array, tags: PhotographTags, *, suffix: Literal["jpg", "png"], quality: int) -> bytes:
    """An image (height, width, 3) as a file with its tags."""
    stream, image = io.BytesIO(), Image.fromarray(rgb)
    exif, xmp = _exif(tags), _xmp(tags) if tags.is_airborne else b""
    if suffix == "jpg":
        # Colour at full resolution: the edge of a crack is a few pixels wide.
        image.save(stream, "JPEG", quality=quality, subsampling=0, exif=exif, xmp=xmp)
    else:
        info = PngImagePlugin.PngInfo()
        if xmp:
            info.add_itxt("XML:com.adobe.xmp", xmp.decode())
        image.save(stream, "PNG", exif=exif, pnginfo=info)
    return stream.getvalue()


def _exif(tags: PhotographTags) -> Image.Exif:
    exif, longitude, local = Image.Exif(), tags.lonlat[0], _local(tags)
    maker, model = _maker_and_model(tags.camera)
    tag, when = ExifTags.Base, local.strftime("%Y:%m:%d %H:%M:%S")
    exif.update({tag.Make: maker, tag.Model: model, tag.Software: SOFTWARE, tag.Orientation: 1})
    exif.update({tag.ImageDescription: "Synthetic image", tag.DateTime: when})
    width, height = tags.sensor_mm
    in_35mm = tags.focal_mm * hypot(*FULL_FRAME_MM) / hypot(width, height)
    photo = exif.get_ifd(ExifTags.IFD.Exif)
    photo[tag.DateTimeOriginal] = when
    photo[tag.OffsetTimeOriginal] = f"{round(longitude / 15):+03d}:00"
    photo[tag.FocalLength] = round(tags.focal_mm, 3)
    photo[tag.FocalLengthIn35mmFilm] = round(in_35mm)
    photo[tag.FocalPlaneXResolution] = round(tags.size_px[0] / width, 4)
    photo[tag.FocalPlaneYResolution] = round(tags.size_px[1] / height, 4)
    photo[tag.FocalPlaneResolutionUnit] = MILLIMETRE
    if tags.exposure is not None:
        photo[tag.ExposureTime] = tags.exposure.shutter_s
        photo[tag.FNumber] = round(tags.exposure.f_number, 2)
        photo[tag.ISOSpeedRatings] = round(tags.exposure.iso)
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(_gps(tags))
    return exif


def _maker_and_model(title: str) -> tuple[str, str]:
    """A camera's title begins with its maker's name; that of a fictitious camera does not."""
    maker, _, model = title.partition(" ")
    return ("PaveTwin", title) if maker == "Virtual" else (maker, model)


def _gps(tags: PhotographTags) -> dict[int, Any]:
    tag, (longitude, latitude), when = ExifTags.GPS, tags.lonlat, tags.when
    return {
        tag.GPSVersionID: b"\x02\x03\x00\x00",
        tag.GPSLatitudeRef: "N" if latitude >= 0 else "S",
        tag.GPSLatitude: _sexagesimal(latitude),
        tag.GPSLongitudeRef: "E" if longitude >= 0 else "W",
        tag.GPSLongitude: _sexagesimal(longitude),
        tag.GPSAltitudeRef: b"\x00",
        tag.GPSAltitude: round(tags.altitude_m, 3),
        tag.GPSTimeStamp: (float(when.hour), float(when.minute), float(when.second)),
        tag.GPSImgDirectionRef: "T",
        tag.GPSImgDirection: round(tags.heading_deg, 3),
        tag.GPSMapDatum: "WGS-84",
        tag.GPSDateStamp: when.strftime("%Y:%m:%d"),
    }


def _sexagesimal(angle_deg: float) -> tuple[float, float, float]:
    """Degrees, minutes and seconds to a ten-thousandth, 3 mm on the ground."""
    seconds = round(abs(angle_deg) * 36_000_000) / 10_000
    return float(seconds // 3600), float(seconds // 60 % 60), round(seconds % 60, 4)


def _local(tags: PhotographTags) -> datetime:
    """Local mean time by longitude, since the time zone is unknown."""
    return tags.when + timedelta(hours=round(tags.lonlat[0] / 15))


def _xmp(tags: PhotographTags) -> bytes:
    """DJI's: angles in degrees, yaw clockwise from north, pitch −90 straight down."""
    longitude, latitude = tags.lonlat
    yaw = (tags.heading_deg + 180.0) % 360.0 - 180.0
    altitude = tags.altitude_m
    values = {
        "AbsoluteAltitude": f"{altitude:+.2f}",
        "RelativeAltitude": f"{altitude:+.2f}",
        "GpsLatitude": f"{latitude:.8f}",
        "GpsLongitude": f"{longitude:.8f}",
        "GimbalRollDegree": "+0.00",
        "GimbalYawDegree": f"{yaw:+.2f}",
        "GimbalPitchDegree": f"{tags.pitch_deg:+.2f}",
        "FlightRollDegree": "+0.00",
        "FlightYawDegree": f"{yaw:+.2f}",
        "FlightPitchDegree": "+0.00",
    }
    attributes = "\n".join(f'   {DJI}:{name}="{value}"' for name, value in values.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        '  <rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"\n'
        f"{attributes}/>\n </rdf:RDF>\n</x:xmpmeta>\n"
        '<?xpacket end="w"?>'
    ).encode()


def above_sea_m_in(gps: Mapping[int, Any], dji: Mapping[str, float]) -> float | None:
    if (stated := dji.get("AbsoluteAltitude")) is not None:
        return stated
    altitude = number_in(gps.get(ExifTags.GPS.GPSAltitude))
    below = gps.get(ExifTags.GPS.GPSAltitudeRef) in (1, b"\x01")
    return -altitude if altitude is not None and below else altitude


def position_error_m_in(gps: Mapping[int, Any], dji: Mapping[str, float]) -> float | None:
    """Position error of a receiver with corrections (DJI's RTK), or EXIF's `GPSHPositioningError`."""
    stated = [dji[name] for name in ("RtkStdLon", "RtkStdLat") if name in dji]
    error = max(stated, default=number_in(gps.get(ExifTags.GPS.GPSHPositioningError)))
    return error if error is not None and error >= 0 else None


def dji_tags(image: Image.Image) -> dict[str, float]:
    """Numbers of the XMP tags of DJI, which are attributes or elements."""
    packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
    text = packet.decode("utf-8", "replace") if isinstance(packet, bytes) else str(packet)
    found = re.findall(rf"{DJI}:(\w+)(?:=\"|>)\s*([-+]?[0-9.]+)", text)
    numbers = ((name, number_in(value)) for name, value in found)
    return {name: value for name, value in numbers if value is not None}


def lonlat_in(gps: Mapping[int, Any], dji: Mapping[str, float]) -> LonLat | None:
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


def focal_px_in(photo: Mapping[int, Any], size: tuple[int, int]) -> float | None:
    """Focal length from the sensor's resolution and the original width, or from the 35 mm equivalent."""
    tag = ExifTags.Base
    focal_mm, density = number_in(photo.get(tag.FocalLength)), number_in(photo.get(tag.FocalPlaneXResolution))
    unit = MM_OF_UNIT.get(photo.get(tag.FocalPlaneResolutionUnit, 2))
    if focal_mm and density and unit:
        return focal_mm * density / unit * size[0] / (number_in(photo.get(tag.ExifImageWidth)) or size[0])
    in_35mm = number_in(photo.get(tag.FocalLengthIn35mmFilm))
    return in_35mm * hypot(*size) / hypot(*FULL_FRAME_MM) if in_35mm else None


def number_in(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if isfinite(number) else None
