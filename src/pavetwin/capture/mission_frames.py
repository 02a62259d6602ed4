"""The frames of a mission, those in which it confirmed defects or all, rendered after the flight from its records: a
dataset with labels.

The mission itself draws nothing. Its camera, poses, times and traffic are in its detections, date, time and clouds in
its conditions. The light stays as it is when the mission begins.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from pavetwin.capture.context import packages_in_use
from pavetwin.capture.daylight import Daylight
from pavetwin.capture.formats import find_formats
from pavetwin.capture.images import link_image, record_of, write_image, write_over_all, write_yaml
from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.platforms import Pose
from pavetwin.capture.record import Record
from pavetwin.capture.samples import image_name, prefix
from pavetwin.capture.settings import FILE, CaptureSettings, description
from pavetwin.capture.truth import LabelledObject, SceneState, labelled_objects
from pavetwin.files import writing_folder
from pavetwin.labels.classes import category_of_defect
from pavetwin.mission.inspected_defects import captured_frame
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import write_captures
from pavetwin.mission.versions import software_versions
from pavetwin.sensing import Frame
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.aircraft import camera_name, camera_of
from pavetwin.uav.cameras import Camera

if TYPE_CHECKING:
    from pavetwin._core import Trace
    from pavetwin.render.frame import RenderedFrame

FOLDER: Final = "frames"

CAPTURES: Final = "captures.csv"
"""In it: which image is of which capture."""

SPLIT: Final = "test"
"""Split of mission frames: a detector is tested on them, although it may have been trained on the same streets."""

PLATFORM: Final = "uav"

LARGEST_PX: Final = 2048
"""Limit of a frame's longer side; a camera with more pixels is rendered at a lower resolution with the same view."""


def save_frames(
    result: MissionResult,
    images: MissionImages,
    folder: Path,
    *,
    every: bool = False,
    adapter: str = "",
    on_progress: Callable[[float], None] | None = None,
) -> int:
    """Take the frame of every capture that confirmed a defect, into `frames/` of a mission's folder, and name it in
    `captures.geojson`. Returns how many were taken. `frames/captures.csv` names the capture of each image.

    Args:
        images: of the mission's environment, traffic and seed.
        every: take the frames of all captures.
        adapter: name of the graphics adapter.

    Raises:
        PaveTwinError: the frames cannot be written.
    """
    confirmed: dict[int, list[int]] = {}
    for capture, defect in zip(result.confirmed.capture.tolist(), result.confirmed.defect.tolist(), strict=True):
        confirmed.setdefault(capture, []).append(defect)
    captures = range(len(result.captures["t_s"])) if every else list(confirmed)
    names, lines = [], ["capture,image\n"]
    with writing_folder(folder / FOLDER, replace=True) as place:
        if captures:
            camera = _MissionCamera(result, images)
            settings = camera.settings(len(captures))
            formats = find_formats(settings.formats)
            for number, capture in enumerate(captures):
                defects = confirmed.get(capture, [])
                record, picture = camera.frame(frame_of(result, capture), defects, number, settings)
                write_image(place, record, picture, formats)
                link_image(place, record, formats)
                names += [f"{FOLDER}/{record.image}"] * len(defects)
                lines.append(f"{capture},{record.image}\n")
                if on_progress is not None:
                    on_progress((number + 1) / len(captures))
            (place / CAPTURES).write_text("".join(lines), encoding="utf-8")
            write_over_all(place, formats, (SPLIT,))
            packages = packages_in_use(settings, images.world)
            versions = software_versions(images=True, adapter=adapter, packages=packages)
            write_yaml(place / FILE, description(settings, images.world, versions))
    write_captures(result, folder / "captures.geojson", names)
    return len(captures)


def frame_size(image_px: Sequence[int]) -> tuple[int, int]:
    """Width and height of the frames of a camera."""
    scale = min(1.0, LARGEST_PX / max(image_px))
    return round(image_px[0] * scale), round(image_px[1] * scale)


def frame_of(result: MissionResult, capture: int) -> Frame:
    """The frame of a capture, as its saved image is taken.

    Args:
        capture: its index in `result.captures`.
    """
    if capture not in result.confirmed.capture:
        return captured_frame(result, capture)
    conditions = result.settings.conditions
    return replace(result.log.frames[capture], conditions=conditions, sightings=(), sun_elevation_deg=None)


def labelled_frame(
    images: MissionImages, trace: "Trace", capture: Frame, size_px: tuple[int, int]
) -> tuple["RenderedFrame", list[LabelledObject]]:
    """The image of a capture, and the objects that it shows.

    Args:
        trace: of the images' recording, whole.
        size_px: width, height; the camera's view stays.

    Raises:
        PaveTwinError: there is no adapter to draw with, or the sun is below the horizon.
    """
    frame = images.rendered(capture, size_px)
    agents = trace.agents_at(images.replay.recorded_s(capture.time_s))
    state = SceneState(images.world, agents, images.replay.recording.agents.kind, images.parked)
    return frame, labelled_objects(frame, state)


@dataclass(frozen=True)
class _MissionCamera:
    """Renders the frames of a mission."""

    result: MissionResult
    images: MissionImages

    @cached_property
    def camera(self) -> Camera:
        return camera_of(self.result.settings)

    @cached_property
    def trace(self) -> "Trace":
        return trace_of(self.images.replay.recording)

    def settings(self, images: int) -> CaptureSettings:
        """The settings of a dataset of such frames."""
        return CaptureSettings(
            platforms=(PLATFORM,),
            images=images,
            seed=self.result.seed,
            altitudes_m=(self.result.settings.altitude_m,),
            densities=(self.images.replay.recording.name,),
            size_px=frame_size(self.camera.image_px),
            camera=camera_name(self.result.settings),
            split=(0.0, 0.0, 1.0),
            empty=0.0,
            parking=self.result.settings.parking,
        )

    def frame(
        self, capture: Frame, confirmed: Sequence[int], number: int, settings: CaptureSettings
    ) -> tuple[Record, bytes]:
        """The record of a capture and its image as a file.

        Args:
            confirmed: ids of the defects that it confirms.
        """
        world, recording = self.images.world, self.images.replay.recording
        frame, objects = labelled_frame(self.images, self.trace, capture, settings.size_px)
        daylight = replace(self.begin, when=self.begin.when + timedelta(seconds=capture.time_s))
        recorded_s = self.images.replay.recorded_s(capture.time_s)
        aims = sorted({category_of_defect(world.defects[defect].kind).name for defect in confirmed})
        return record_of(
            frame,
            Pose(frame.view, recorded_s, capture.yaw_rad, -np.pi / 2, self.camera, "gimbal"),
            daylight,
            world,
            settings,
            PLATFORM,
            index=number,
            name=image_name(self.prefix, number),
            split=SPLIT,
            traffic={"density": recording.name, "seed": recording.origin.seed, "time_s": round(recorded_s, 4)},
            aim={
                "requested": aims,
                "met": aims,
                "attempt": 0,
                "confirmed": [f"defect {defect}" for defect in confirmed],
            },
            objects=tuple(objects),
        )

    @cached_property
    def prefix(self) -> str:
        result = self.result
        made_from = result.settings.model_dump(mode="json") | {"traffic": result.traffic, "policy": result.policy}
        return prefix(self.images.world, result.seed, "mission", made_from)

    @cached_property
    def begin(self) -> Daylight:
        """Daylight at the start of the mission."""
        return Daylight.of(self.result.settings.conditions, self.images.world)
