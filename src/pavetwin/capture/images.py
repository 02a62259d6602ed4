"""One image: camera samples of a spec are rendered until one shows what it must; then its record is made."""

from typing import Any, Protocol

from pavetwin.capture.daylight import Daylight
from pavetwin.capture.exif import ImageMetadata
from pavetwin.capture.image_spec import ImageSpec
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, Platform, Pose
from pavetwin.capture.record import Record
from pavetwin.capture.samples import CameraSample, draw_sample, next_attempt, relaxed
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.truth import LabelledObject, SceneState, labelled_objects
from pavetwin.perception.drone_tags import encoded
from pavetwin.render.frame import RenderedFrame
from pavetwin.world.model import World


class FrameSource(Protocol):
    """Renders the image of a camera sample, with its ground truth."""

    def frame(self, sample: CameraSample, context: CaptureContext) -> RenderedFrame:
        """The same sample gives the same frame, whatever was rendered before."""
        ...


def take_image(
    platform: Platform, frame_source: FrameSource, spec: ImageSpec, first: CameraSample | None
) -> tuple[Record, bytes]:
    """Take the image of a spec: its record, and the image file's content.

    Args:
        first: the spec's first attempt, as `draw_sample` gives it.

    Raises:
        PaveTwinError: no attempt shows what it must.
    """
    context = platform.context
    attempt, sample = 0, first
    while True:
        if sample is not None:
            frame = frame_source.frame(sample, context)
            seen = labelled_objects(frame, _scene_state(sample, context))
            if meets_spec(sample.spec, seen, context):
                content = {"index": spec.number, "name": spec.name, "split": spec.split, "objects": tuple(seen)}
                content |= {"traffic": _traffic(sample, context), "aim": _aim(sample, spec)}
                return record_of(
                    frame, sample.pose, sample.daylight, context.world, context.settings, spec.platform, **content
                )
        attempt = next_attempt(spec, attempt, sample)
        sample = draw_sample(platform, relaxed(platform, spec, attempt), attempt)


def meets_spec(spec: ImageSpec, seen: list[LabelledObject], context: CaptureContext) -> bool:
    """Return whether visible objects meet a spec: no defect of another split, and one of the aimed classes, or none."""
    defects = [int(obj.id.removeprefix("defect ")) for obj in seen if obj.id.startswith("defect ")]
    if not spec.aims:
        return not defects
    aims = {category.name for category in spec.aims}
    if not any(obj.category in aims and obj.ignored is None for obj in seen):
        return False
    return bool((context.defect_index.split_of[defects] == spec.split).all())


def _scene_state(sample: CameraSample, context: CaptureContext) -> SceneState:
    density = sample.spec.density
    agents = context.traces[density].agents_at(sample.pose.time_s)
    kinds = context.recordings[density].agents.kind
    return SceneState(context.world, agents, kinds, context.parked(sample.conditions, density))


def record_of(
    frame: RenderedFrame,
    pose: Pose,
    daylight: Daylight,
    world: World,
    settings: CaptureSettings,
    platform: str,
    **content: Any,
) -> tuple[Record, bytes]:
    """The record of a frame, and the image file's content.

    Args:
        content: of the record: `index`, `name`, `split`, `traffic`, `aim` and `objects`.
    """
    flies = PLATFORMS.get(platform).uses_altitude
    taken = ImageMetadata(pose, world.georeference, daylight.when, frame.exposure, flies)
    record = Record(
        suffix=f".{settings.picture}",
        size_px=pose.view.size_px,
        camera={"platform": platform, "mount": pose.mount, **taken.as_dict()},
        light=daylight.as_dict(),
        **content,
    )
    return record, encoded(frame.rgb, taken.tags, picture=settings.picture, quality=settings.quality)


def _traffic(sample: CameraSample, context: CaptureContext) -> dict[str, Any]:
    recording = context.recordings[sample.spec.density]
    ego = {} if sample.pose.ego is None else {"ego": f"agent {sample.pose.ego}"}
    return {
        "density": sample.spec.density,
        "seed": recording.origin.seed,
        "time_s": round(sample.pose.time_s, 4),
        **ego,
    }


def _aim(sample: CameraSample, spec: ImageSpec) -> dict[str, Any]:
    """The requested classes, and those of the spec that the image met."""
    requested, met = ([category.name for category in each.aims] for each in (spec, sample.spec))
    return {"requested": requested, "met": met, "attempt": sample.attempt}
