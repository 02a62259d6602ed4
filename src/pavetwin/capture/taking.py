"""One image: shots of a wish until one shows what it must, and what there is to write about it."""

from typing import Any, Protocol

from pavetwin.capture.exif import Taken, encoded
from pavetwin.capture.plan import Wish
from pavetwin.capture.platforms import Platform, Setting
from pavetwin.capture.record import Record
from pavetwin.capture.shots import Shot, draw_shot, next_attempt, relaxed
from pavetwin.capture.truth import Moment, Thing, things
from pavetwin.render.frame import Frame


class Photographer(Protocol):
    """Takes the picture of a shot, with its truth."""

    def frame(self, shot: Shot, setting: Setting) -> Frame:
        """The same shot gives the same frame, whatever was taken before."""
        ...


def take(platform: Platform, photographer: Photographer, wish: Wish, first: Shot | None) -> tuple[Record, bytes]:
    """An image of a wish: its record, and its picture as a file.

    Args:
        first: the wish's first attempt, as `draw_shot` gives it.

    Raises:
        PaveTwinError: no attempt shows what it must.
    """
    setting = platform.setting
    attempt, shot = 0, first
    while True:
        if shot is not None:
            frame = photographer.frame(shot, setting)
            seen = things(frame, _moment(shot, setting))
            if shows(shot.wish, seen, setting):
                return _record(shot, wish, setting, frame, seen)
        attempt = next_attempt(wish, attempt, shot)
        shot = draw_shot(platform, relaxed(platform, wish, attempt), attempt)


def shows(wish: Wish, seen: list[Thing], setting: Setting) -> bool:
    """Whether what is seen is what was wished: no defect of another split, one that is aimed at, or none."""
    defects = [int(thing.id.removeprefix("defect ")) for thing in seen if thing.id.startswith("defect ")]
    if not wish.aims:
        return not defects
    aims = {category.name for category in wish.aims}
    if not any(thing.category in aims and thing.ignored is None for thing in seen):
        return False
    return bool((setting.sight.split_of[defects] == wish.split).all())


def _moment(shot: Shot, setting: Setting) -> Moment:
    density = shot.wish.density
    agents = setting.traces[density].agents_at(shot.pose.time_s)
    return Moment(setting.world, agents, setting.recordings[density].agents.kind)


def _record(shot: Shot, wish: Wish, setting: Setting, frame: Frame, seen: list[Thing]) -> tuple[Record, bytes]:
    pose, settings = shot.pose, setting.settings
    taken = Taken(
        view=pose.view,
        camera=pose.camera,
        heading_rad=pose.heading_rad,
        pitch_rad=pose.pitch_rad,
        place=setting.world.georeference,
        when=shot.daylight.when,
        exposure=frame.exposure,
        is_airborne=wish.altitude_m is not None,
    )
    record = Record(
        index=wish.index,
        split=wish.split,
        suffix=f".{settings.picture}",
        size_px=pose.view.size_px,
        camera={"platform": settings.platform, "mount": pose.mount, **taken.as_dict()},
        light=shot.daylight.as_dict(),
        traffic=_traffic(shot, setting),
        aim=_aim(shot, wish),
        things=tuple(seen),
    )
    return record, encoded(frame.rgb, taken, picture=settings.picture, quality=settings.quality)


def _traffic(shot: Shot, setting: Setting) -> dict[str, Any]:
    recording = setting.recordings[shot.wish.density]
    ego = {} if shot.pose.ego is None else {"ego": f"agent {shot.pose.ego}"}
    return {"density": shot.wish.density, "seed": recording.origin.seed, "time_s": round(shot.pose.time_s, 4), **ego}


def _aim(shot: Shot, wish: Wish) -> dict[str, Any]:
    """What was wished, and what the image that was kept had to show."""
    wished, met = ([category.name for category in each.aims] for each in (wish, shot.wish))
    return {"wished": wished, "met": met, "attempt": shot.attempt}
