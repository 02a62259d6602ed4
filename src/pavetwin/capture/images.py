"""One image: shots of a wish until one shows what it must, and what there is to write about it."""

from typing import Any, Protocol

from pavetwin.capture.exif import ShotMetadata, encoded
from pavetwin.capture.plan import ImageSpec
from pavetwin.capture.platforms import CaptureContext, Platform
from pavetwin.capture.record import Record
from pavetwin.capture.samples import CameraSample, draw_sample, next_attempt, relaxed
from pavetwin.capture.truth import LabelledObject, SceneState, things
from pavetwin.render.frame import RenderedFrame


class FrameSource(Protocol):
    """Takes the picture of a shot, with its truth."""

    def frame(self, sample: CameraSample, setting: CaptureContext) -> RenderedFrame:
        """The same shot gives the same frame, whatever was taken before."""
        ...


def take(
    platform: Platform, frame_source: FrameSource, spec: ImageSpec, first: CameraSample | None
) -> tuple[Record, bytes]:
    """An image of a wish: its record, and its picture as a file.

    Args:
        first: the wish's first attempt, as `draw_sample` gives it.

    Raises:
        PaveTwinError: no attempt shows what it must.
    """
    setting = platform.setting
    attempt, sample = 0, first
    while True:
        if sample is not None:
            frame = frame_source.frame(sample, setting)
            seen = things(frame, _moment(sample, setting))
            if shows(sample.spec, seen, setting):
                return _record(sample, spec, setting, frame, seen)
        attempt = next_attempt(spec, attempt, sample)
        sample = draw_sample(platform, relaxed(platform, spec, attempt), attempt)


def shows(spec: ImageSpec, seen: list[LabelledObject], setting: CaptureContext) -> bool:
    """Whether what is seen is what was wished: no defect of another split, one that is aimed at, or none."""
    defects = [int(thing.id.removeprefix("defect ")) for thing in seen if thing.id.startswith("defect ")]
    if not spec.aims:
        return not defects
    aims = {category.name for category in spec.aims}
    if not any(thing.category in aims and thing.ignored is None for thing in seen):
        return False
    return bool((setting.sight.split_of[defects] == spec.split).all())


def _moment(sample: CameraSample, setting: CaptureContext) -> SceneState:
    density = sample.spec.density
    agents = setting.traces[density].agents_at(sample.pose.time_s)
    return SceneState(setting.world, agents, setting.recordings[density].agents.kind)


def _record(
    sample: CameraSample, spec: ImageSpec, setting: CaptureContext, frame: RenderedFrame, seen: list[LabelledObject]
) -> tuple[Record, bytes]:
    pose, settings = sample.pose, setting.settings
    taken = ShotMetadata(
        view=pose.view,
        camera=pose.camera,
        yaw_rad=pose.yaw_rad,
        pitch_rad=pose.pitch_rad,
        place=setting.world.georeference,
        when=sample.daylight.when,
        exposure=frame.exposure,
        is_airborne=spec.altitude_m is not None,
    )
    record = Record(
        index=spec.index,
        split=spec.split,
        suffix=f".{settings.picture}",
        size_px=pose.view.size_px,
        camera={"platform": settings.platform, "mount": pose.mount, **taken.as_dict()},
        light=sample.daylight.as_dict(),
        traffic=_traffic(sample, setting),
        aim=_aim(sample, spec),
        things=tuple(seen),
    )
    return record, encoded(frame.rgb, taken, picture=settings.picture, quality=settings.quality)


def _traffic(sample: CameraSample, setting: CaptureContext) -> dict[str, Any]:
    recording = setting.recordings[sample.spec.density]
    ego = {} if sample.pose.ego is None else {"ego": f"agent {sample.pose.ego}"}
    return {
        "density": sample.spec.density,
        "seed": recording.origin.seed,
        "time_s": round(sample.pose.time_s, 4),
        **ego,
    }


def _aim(sample: CameraSample, spec: ImageSpec) -> dict[str, Any]:
    """What was wished, and what the image that was kept had to show."""
    requested, met = ([category.name for category in each.aims] for each in (spec, sample.spec))
    return {"requested": requested, "met": met, "attempt": sample.attempt}
