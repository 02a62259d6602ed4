"""The rendered frame of a capture, with labels and detections: the image that `fly --save-frames` saves of it.

A preview comes first: the same view in as many pixels as are shown, without labels, in a tenth of the time.

Poses and detections of all captures are in a file next to the played data. World, defects and traffic are read
again from what the missions' specs name, once for all frames of these missions.
"""

import base64
import json
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from PIL import Image

from pavetwin.app.requests import FramePart
from pavetwin.app.session_cache import kept_world
from pavetwin.arrays import UInt8Array
from pavetwin.capture.mission_frames import frame_of, frame_size, labelled_frame
from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.truth import LabelledObject
from pavetwin.config.mission import SensingSettings
from pavetwin.mission.environment import shutter_s
from pavetwin.mission.inputs import load_inputs
from pavetwin.mission.result import MissionResult
from pavetwin.mission.spec import MissionSpec
from pavetwin.sensing import Frame
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.aircraft import camera_of

if TYPE_CHECKING:
    from pavetwin._core import Trace
    from pavetwin.render.frame import RenderedFrame

FILE: Final = "captures.json"

SHOWN_PX: Final = 768
"""Longer side of the image that the browser gets: twice the panel's width in CSS pixels."""

_QUALITY: Final = 82


def write_frame_source(results: Sequence[MissionResult], folder: Path) -> None:
    """Write what the frames of missions over the same traffic are rendered from."""
    missions = [
        {"spec": result.spec.as_values(), "sensor": result.sensor, "captures": _captures(result)} for result in results
    ]
    (folder / FILE).write_text(json.dumps(missions), encoding="utf-8")


def _captures(result: MissionResult) -> list[dict[str, Any]]:
    found, defects = result.detections, result.environment.defects
    rows = defaultdict(list)
    for row, (capture, defect) in enumerate(zip(found.capture.tolist(), found.defect.tolist(), strict=True)):
        if defect < 0 or found.footprint[row] is not defects[defect].polygon:  # exact outlines are not drawn
            rows[capture].append(row)
    captures = []
    for number in range(len(result.captures["t_s"])):
        frame = frame_of(result, number)
        detected = [
            _detected(
                found.class_name[row],
                float(found.confidence[row]),
                found.outcome[row].value,
                frame,
                frame.box_of(found.footprint[row]),
            )
            for row in rows[number]
        ]
        pose = {"time_s": frame.time_s, "position": frame.position, "yaw_rad": frame.yaw_rad}
        captures.append({**pose, "velocity_mps": frame.velocity_mps, "detections": detected})
    return captures


def _detected(kind: str, confidence: float, outcome: str | None, frame: Frame, box: Sequence[float]) -> dict[str, Any]:
    shown = _share(box, frame.camera.image_px)
    return {"class": kind, "confidence": round(confidence, 3), "outcome": outcome, "box": shown}


def _share(box: Sequence[float], size_px: Sequence[int]) -> list[float]:
    """Left, top, right, bottom as shares of the image's width and height."""
    return [round(float(edge) / size_px[at % 2], 5) for at, edge in enumerate(box)]


class GivenUpError(Exception):
    """A frame is no longer wanted."""


def shown_frame(
    folder: Path, mission: int, capture: int, part: FramePart, is_wanted: Callable[[], bool] = lambda: True
) -> dict[str, Any]:
    """The frame of a capture as the browser shows it.

    Args:
        folder: with what `write_frame_source` wrote.
        mission: its index there.
        part: what of it.
        is_wanted: asked between steps whether it still is.

    Returns:
        Of a preview and a labelled frame `jpeg` in base64, of `SHOWN_PX`; `labels`, those of the dataset that
        `fly --save-frames` saves, None of a preview; `detections` of the mission's `sensor`. Of a search `searched`,
        what the shipped detector finds. Boxes are shares of the image's sides.

    Raises:
        PaveTwinError: the mission's inputs have changed, there is no adapter to draw with, or the sun is
            below the horizon.
        GivenUpError: it is no longer wanted.
    """
    source = _sources(folder)[mission]

    def check() -> None:
        if not is_wanted():
            raise GivenUpError

    with source.images.scene_renderer.giving_up_by(check):
        return _shown(source, capture, part)


def _shown(source: "MissionFrames", capture: int, part: FramePart) -> dict[str, Any]:
    if part is FramePart.SEARCHED:
        return {"searched": source.searched(capture)}
    labels = None
    if part is FramePart.PREVIEW:
        rgb = source.preview(capture)
    else:
        rendered, objects = source.rendered(capture)
        rgb = rendered.rgb
        labels = [
            {"id": each.id, "class": each.category, "box": _share(each.box, rendered.view.size_px)}
            for each in objects
            if each.ignored is None
        ]
    return {
        "jpeg": _jpeg(rgb),
        "labels": labels,
        "sensor": source.sensor,
        "detections": source.captures[capture]["detections"],
    }


def _jpeg(rgb: UInt8Array) -> str:
    """A JPEG of at most `SHOWN_PX`, in base64."""
    image, content = Image.fromarray(rgb), BytesIO()
    image.thumbnail((SHOWN_PX, SHOWN_PX), Image.Resampling.LANCZOS)
    image.save(content, "JPEG", quality=_QUALITY)
    return base64.b64encode(content.getvalue()).decode()


@dataclass(frozen=True)
class MissionFrames:
    """The frames of one mission."""

    spec: MissionSpec
    sensor: str
    captures: Sequence[Mapping[str, Any]]
    images: MissionImages
    trace: "Trace"

    def frame(self, capture: int) -> Frame:
        settings, pose = self.spec.settings, self.captures[capture]
        return Frame(
            number=capture,
            time_s=pose["time_s"],
            position=(pose["position"][0], pose["position"][1]),
            altitude_m=settings.altitude_m,
            yaw_rad=pose["yaw_rad"],
            camera=camera_of(settings),
            conditions=settings.conditions,
            velocity_mps=(pose["velocity_mps"][0], pose["velocity_mps"][1]),
            exposure_s=shutter_s(settings),
        )

    def rendered(self, capture: int) -> tuple["RenderedFrame", list[LabelledObject]]:
        """The image that `fly --save-frames` saves of a capture, and its labelled objects."""
        frame = self.frame(capture)
        return labelled_frame(self.images, self.trace, frame, frame_size(frame.camera.image_px))

    def preview(self, capture: int) -> UInt8Array:
        """(height, width, 3) sRGB, of `SHOWN_PX`: the same view of the same camera in fewer pixels."""
        frame = self.frame(capture)
        saved = frame_size(frame.camera.image_px)
        scale = min(1.0, SHOWN_PX / max(saved))
        size = round(saved[0] * scale), round(saved[1] * scale)
        return self.images.rendered(frame, size, truth=False).rgb

    def searched(self, capture: int) -> list[dict[str, Any]]:
        """Detections of the shipped detector in a rendered capture."""
        frame = self.frame(capture)
        found = self._detector.detect(replace(frame, source=self.images))
        rows = zip(found.class_name, found.confidence.tolist(), found.box_px.tolist(), strict=True)
        return [_detected(name, confidence, None, frame, box) for name, confidence, box in rows]

    @cached_property
    def _detector(self) -> DetectorSensor:
        return DetectorSensor(SensingSettings(sensor="detector"), self.spec.seed)


@lru_cache(maxsize=1)
def _sources(folder: Path) -> tuple[MissionFrames, ...]:
    """Missions of a folder, whose name identifies their content."""
    missions = json.loads((folder / FILE).read_text(encoding="utf-8"))
    specs = [MissionSpec.parse(mission["spec"], where=FILE) for mission in missions]
    inputs = load_inputs(specs[0], world=kept_world(Path(specs[0].world.path)))
    last_s = max((capture["time_s"] for mission in missions for capture in mission["captures"]), default=0.0)
    with inputs.replay:
        inputs.replay.extend(last_s)
    environment, replay = inputs.environment, inputs.replay
    trace = trace_of(replay.recording)
    return tuple(
        MissionFrames(
            spec,
            mission["sensor"],
            mission["captures"],
            MissionImages(environment.inspected_world, replay, spec.seed, environment.parked),
            trace,
        )
        for spec, mission in zip(specs, missions, strict=True)
    )
