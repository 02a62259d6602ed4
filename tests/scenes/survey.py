"""Photographs of spots on a street, stored like captures, with EXIF and XMP."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from math import pi
from pathlib import Path

from shapely import Point, box

from pavetwin.capture.exif import ImageMetadata
from pavetwin.capture.platforms import Pose
from pavetwin.perception.drone_tags import encoded
from pavetwin.sensing import Frame
from pavetwin.sensing.sensor import trial_frames
from pavetwin.uav.cameras import find_camera
from pavetwin.world.georeference import GeoReference, anchored
from scenes.spots import Painter, Spot

PLACE: GeoReference = anchored(52.47, 13.44)

SPOTS: Sequence[Spot] = (
    ("pothole", Point(3.0, 1.0).buffer(0.4)),
    ("pothole", Point(9.0, -1.5).buffer(0.3)),
    ("single_crack", box(5.0, -0.1, 7.0, 0.1)),
    ("car", box(0.0, 2.5, 4.5, 4.3)),
)
"""Class and outline, in metres about `PLACE`."""

ALTITUDE_M = 10.0


def captures(count: int = 5, yaw_rad: float = 0.3) -> list[Frame]:
    """Every 3 m along the street, 960 pixels across: 15 mm a pixel."""
    camera = find_camera("mavic3e").model_copy(update={"image_px": (960, 720)})
    like = replace(trial_frames(1)[0], camera=camera, altitude_m=ALTITUDE_M, source=Painter(SPOTS))
    return [replace(like, number=at, position=(3.0 * at, 0.0), yaw_rad=yaw_rad) for at in range(count)]


def photograph(frame: Frame, *, pitch_rad: float = -pi / 2, place: GeoReference = PLACE) -> bytes:
    """A PNG, which keeps the pixels as they are painted."""
    pose = Pose(frame.view, frame.time_s, frame.yaw_rad, pitch_rad, frame.camera, "gimbal")
    taken = ImageMetadata(pose, place, datetime(2025, 3, 20, 10, tzinfo=UTC), None, True)
    return encoded(frame.image(), taken.tags, suffix="png", quality=90)


def photographs(folder: Path, count: int = 5) -> Path:
    folder.mkdir()
    for frame in captures(count):
        (folder / f"{frame.number:03}.png").write_bytes(photograph(frame))
    return folder
