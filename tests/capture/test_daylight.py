"""The light of images and of a mission's frames follows from their conditions."""

import json
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image
from shapely import Point

from pavetwin.capture.daylight import LEAST_ELEVATION_DEG, Daylight, draw_conditions
from pavetwin.capture.mission_frames import save_frames
from pavetwin.capture.mission_images import MissionImages
from pavetwin.capture.record import read_records
from pavetwin.capture.scene_renderer import SceneRenderer
from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.mission.replay import Replay
from pavetwin.mission.saving import save_mission
from pavetwin.scene.light import centre_lonlat
from pavetwin.scene.view import View
from scenes.recordings import recording
from scenes.tiny import Scene, straight

VAN_ACROSS = recording(("van",), lambda *_: (20.0, -0.5, np.pi / 2, 0.0), frames=600)
"""A van that stands across the street at x = 20 m."""


def test_drawn_conditions_have_the_sun_up_and_are_all_different() -> None:
    world = straight()
    rng = np.random.default_rng(5)
    drawn = [draw_conditions(rng, *centre_lonlat(world)) for _ in range(40)]
    lights = [Daylight.of(conditions, world).light for conditions in drawn]
    assert all(light.sun_elevation_deg >= LEAST_ELEVATION_DEG for light in lights)
    assert all(
        (light.cloud_cover, light.turbidity) == (each.clouds, each.turbidity)
        for light, each in zip(lights, drawn, strict=True)
    )
    assert len({(each.date, each.time) for each in drawn}) == 40
    assert {each.wind_mps for each in drawn} == {0.0}


class Watched(SceneRenderer):
    """Remembers the views."""

    views: list[View]

    def picture(self, view: View, *asked: object, **more: object):  # type: ignore[no-untyped-def,override]
        self.views = [view]
        return super().picture(view, *asked, **more)  # type: ignore[arg-type]


@pytest.mark.needs_adapter
def test_frames_have_the_light_of_the_missions_time_of_day(tmp_path: Path) -> None:
    """A low sun in the east casts shadows to the west, and the reverse; the image's file tells the time."""
    scene = Scene(straight((20, 3)), altitude_m=10.0)
    result = scene.fly("baseline")
    (time_s,) = result.detections.time_s
    images = MissionImages(result.environment.inspected_world, Replay(scene.world, VAN_ACROSS), result.seed)
    drawing = images.scene_renderer = Watched(images.world)
    west_over_east = {}
    for time in ("07:30", "16:30"):
        folder = tmp_path / time
        settings = scene.settings("conditions.date=2026-03-20", f"conditions.time={time}", "conditions.clouds=0")
        flown = replace(result, spec=result.spec.model_copy(update={"settings": settings}))
        save_mission(flown, folder)
        assert save_frames(flown, images, folder) == 1
        (record,) = read_records(folder / "frames")
        name = json.loads((folder / "captures.geojson").read_text())["features"][0]["properties"]["frame"]
        with Image.open(folder / name) as image:
            rgb, exif = np.asarray(image), image.getexif().get_ifd(ExifTags.IFD.Exif)
        (view,) = drawing.views
        beside = [view.project((20 + side, 0.0, 0.0)).astype(int) for side in (-2.8, 2.8)]
        west, east = (rgb[row - 8 : row + 9, column - 8 : column + 9].mean() for column, row in beside)
        west_over_east[time] = west / east
        # At 9° E mean solar time is 36 minutes ahead of UTC; the clock of the camera is at the full hour nearest to it.
        local = datetime.fromisoformat(f"2026-03-20T{time}") + timedelta(minutes=24, seconds=int(time_s))
        assert exif[ExifTags.Base.DateTimeOriginal] == local.strftime("%Y:%m:%d %H:%M:%S")
        assert record.light["cloud_cover"] == 0.0
        assert (record.light["sun_azimuth_deg"] < 180) == (time == "07:30")
    assert west_over_east["07:30"] < 0.8 < 1.25 < west_over_east["16:30"]


def test_frames_at_night_are_refused() -> None:
    night = Scene(straight()).settings("conditions.time=23:30").conditions
    with pytest.raises(PaveTwinError, match=r"`time` 23:30: on 2025-03-20 the sun .* below the horizon") as refusal:
        Daylight.of(night, straight())
    assert "\n" not in str(refusal.value)


def test_the_light_does_not_depend_on_where_the_uav_takes_off() -> None:
    world = straight()
    moved = replace(world, base=Point(world.base.x + 300.0, world.base.y))
    assert Daylight.of(Conditions(), moved) == Daylight.of(Conditions(), world)
