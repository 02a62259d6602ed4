"""A picture as a drone stores it: with its place, height and view in EXIF and in DJI's XMP tags."""

from io import BytesIO

from PIL import ExifTags, Image

LATITUDE, LONGITUDE = 52.5, 13.4
HEIGHT_M = 10.0
FOCAL_MM, SENSOR_MM = 8.8, 13.2
FOCAL_PX = FOCAL_MM / SENSOR_MM * 640
"""For pictures 640 px wide."""


def aerial_photograph(
    picture: Image.Image,
    *,
    orientation: int = 1,
    latitude: float = LATITUDE,
    above_sea_m: float | None = None,
    **dji: float,
) -> bytes:
    """A JPEG taken straight down, heading north, from `HEIGHT_M`, unless DJI's tags are given.

    Args:
        latitude: north, in degrees.
        above_sea_m: EXIF's height above the sea; none unless given.
    """
    exif, tag = Image.Exif(), ExifTags.Base
    exif[tag.Orientation] = orientation
    photo = exif.get_ifd(ExifTags.IFD.Exif)
    photo[tag.FocalLength] = FOCAL_MM
    photo[tag.FocalPlaneXResolution] = 640 / SENSOR_MM
    photo[tag.FocalPlaneResolutionUnit] = 4
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    gps.update({ExifTags.GPS.GPSLatitudeRef: "N", ExifTags.GPS.GPSLatitude: (latitude, 0.0, 0.0)})
    gps.update({ExifTags.GPS.GPSLongitudeRef: "E", ExifTags.GPS.GPSLongitude: (13.0, 24.0, 0.0)})
    if above_sea_m is not None:
        gps.update({ExifTags.GPS.GPSAltitude: abs(above_sea_m), ExifTags.GPS.GPSAltitudeRef: bytes([above_sea_m < 0])})
    said = {"RelativeAltitude": HEIGHT_M, "GimbalYawDegree": 0.0, "GimbalPitchDegree": -90.0} | dji
    tags = " ".join(f'drone-dji:{name}="{value:+.2f}"' for name, value in said.items())
    xmp = f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:Description {tags}/></x:xmpmeta>'
    stream = BytesIO()
    picture.save(stream, "JPEG", quality=95, subsampling=0, exif=exif, xmp=xmp.encode())
    return stream.getvalue()
