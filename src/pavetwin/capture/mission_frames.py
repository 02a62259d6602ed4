"""The frames in which a mission confirmed its defects, taken after the flight from what it wrote down.

The mission itself draws nothing. Its camera, poses, times and traffic are in its findings; only the light is not, for
missions have no hour of the day: every frame has that of ten o'clock by the sun on the day of the equinox, few clouds.
"""

import json
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin.capture.exif import Taken, encoded
from pavetwin.files import writing, writing_folder
from pavetwin.mission.fly import Finding, Flown
from pavetwin.mission.results import findings_geojson
from pavetwin.scene.light import Light
from pavetwin.scene.view import nadir
from pavetwin.seeds import Stream, child
from pavetwin.traffic.recording import Recording
from pavetwin.uav.cameras import find_camera

if TYPE_CHECKING:
    from pavetwin.capture.studio import Theatre

FOLDER: Final = "frames"

LARGEST_PX: Final = 2048
"""Of a frame's longer side; a camera with more pixels is drawn with fewer, its view unchanged."""

_EQUINOX: Final = datetime(2025, 3, 20, 10, tzinfo=UTC)
_CLOUDS: Final = 0.1
_QUALITY: Final = 92


def save_frames(
    flown: Flown,
    recording: Recording,
    folder: Path,
    theatre: "Theatre",
    on_progress: Callable[[float], None] | None = None,
) -> int:
    """Take the frame of every capture that confirmed a defect, into `frames/` of a mission's folder, and name it in
    `captures.geojson`. Returns how many were taken.

    Args:
        recording: the traffic that the mission was flown against, as long as it needed.

    Raises:
        PaveTwinError: the frames cannot be written.
    """
    names = [frame_name(finding) for finding in flown.findings]
    moments = dict(zip(names, flown.findings, strict=True))
    with writing_folder(folder / FOLDER, replace=True) as place:
        for number, (name, finding) in enumerate(moments.items()):
            (place / name).write_bytes(_frame(flown, recording, finding, theatre, number))
            if on_progress is not None:
                on_progress((number + 1) / len(moments))
    content = findings_geojson(flown, [f"{FOLDER}/{name}" for name in names])
    with writing(folder / "captures.geojson") as path:
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return len(moments)


def frame_name(finding: Finding) -> str:
    """By its time; one capture may confirm several defects."""
    return f"t{finding.time_s:08.2f}.jpg"


def frame_size(image_px: Sequence[int]) -> tuple[int, int]:
    """Width and height of the frames of a camera."""
    scale = min(1.0, LARGEST_PX / max(image_px))
    return round(image_px[0] * scale), round(image_px[1] * scale)


def _frame(flown: Flown, recording: Recording, finding: Finding, theatre: "Theatre", number: int) -> bytes:
    camera, world = find_camera(flown.settings.camera.model), flown.stage.world
    view = nadir(
        camera,
        (*finding.position, flown.settings.altitude_m),
        yaw_rad=finding.yaw_rad,
        size_px=frame_size(camera.image_px),
        velocity_mps=_velocity(flown, finding),
    )
    longitude, latitude = (float(value) for value in world.georeference.to_wgs84((world.base.x, world.base.y)))
    start = _EQUINOX - timedelta(hours=longitude / 15)
    light = Light.at(start, latitude_deg=latitude, longitude_deg=longitude, cloud_cover=_CLOUDS)
    noise = int(child(flown.seed, Stream.FRAME, number).integers(1 << 62))
    frame = theatre.picture(view, camera, light, recording, finding.time_s, noise=noise, labels=False)
    taken = Taken(
        view=view,
        camera=camera,
        heading_rad=finding.yaw_rad,
        pitch_rad=-np.pi / 2,
        place=world.georeference,
        when=start + timedelta(seconds=finding.time_s),
        exposure=frame.exposure,
        is_airborne=True,
    )
    return encoded(frame.rgb, taken, picture="jpg", quality=_QUALITY)


def _velocity(flown: Flown, finding: Finding) -> tuple[float, float, float]:
    """Of the UAV, along its heading: the last speed that its track noted."""
    row = int(np.searchsorted(flown.track["t_s"], finding.time_s + 1e-6)) - 1
    speed = float(flown.track["speed_mps"][max(0, row)])
    return speed * float(np.cos(finding.yaw_rad)), speed * float(np.sin(finding.yaw_rad)), 0.0
