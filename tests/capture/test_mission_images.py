"""The images that sensors look at in flight, those that are saved after it, and the contact sheet of a mission."""

import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pavetwin.capture.mission_images import MissionImages, check_frames
from pavetwin.capture.scene_renderer import SceneRenderer
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.sheets import save_mission_sheet
from pavetwin.config import Conditions, load_settings
from pavetwin.draw.contact_sheet import CELL_PX
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import fly_over
from pavetwin.mission.replay import Replay
from pavetwin.mission.result import MissionResult
from pavetwin.scene.view import View
from pavetwin.sensing import Frame, Outcome
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.uav.cameras import find_camera
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.drawn_detector import FILE
from scenes.parking import FULL, full_street
from scenes.recordings import recording
from scenes.spots import Spot, SpotDetector, fly_over_spots
from scenes.tiny import Scene, empty_street, straight

LOOKER = """
from pathlib import Path

import numpy as np

from pavetwin.sensing import Detections, Sensor


class Looker(Sensor):
    place = Path(__file__).with_name("seen.npz")

    def detect(self, frame):
        if self.place.exists():
            return Detections()
        image = frame.image()
        if image.std() > 1:  # the images of the sensor's check are grey
            np.savez(self.place, image=image, number=frame.number)
        return Detections.of_defects(sighting.defect for sighting in frame.sightings)
"""


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_a_sensor_of_ones_own_sees_the_image_that_is_saved(tmp_path: Path) -> None:
    """From the command line; the saved file decodes to the very pixels of the sensor's image, compressed alike."""
    save_world(damaged("cross", 6), tmp_path / "cross")
    (tmp_path / "looker.py").write_text(LOOKER)
    flown = ("--density", "high", "--segments", "1", "--seed", "1", "--policy", "baseline", "--save-frames", "hits")
    sensor = f"sensing.sensor={tmp_path / 'looker.py'}:Looker"
    command = [sys.executable, "-c", "from pavetwin.cli import main; main()", "fly", tmp_path / "cross", *flown]
    command += ["--set", sensor, "--set", "camera.model=paper", "-o", tmp_path / "m"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "200"})
    assert done.returncode == 0, done.stderr
    seen = np.load(tmp_path / "seen.npz")
    assert seen["image"].shape == (950, 1270, 3)
    features = json.loads((tmp_path / "m" / "captures.geojson").read_text())["features"]
    (name,) = {each["properties"]["frame"] for each in features}
    stream = io.BytesIO()
    Image.fromarray(seen["image"]).save(
        stream, "JPEG", quality=CaptureSettings.model_fields["quality"].default, subsampling=0
    )
    with Image.open(tmp_path / "m" / name) as saved, Image.open(stream) as image:
        assert np.array_equal(np.asarray(saved), np.asarray(image))


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_a_detector_sees_the_same_in_rendered_captures_both_ways_and_again() -> None:
    """A stand-in for a trained model that takes everything dark for damage: cars and shadows, and so false alarms."""
    scene = empty_street((20, 1), (30, -1))
    passing = recording(("suv",), lambda _, time_s: (5.0 + 2.0 * time_s, 1.5, 0.0, 2.0), frames=401)

    def flown(aboard: bool) -> MissionResult:
        options = f"sensing.options={{model: {FILE}, image_px: 320, aboard: {str(aboard).lower()}}}"
        settings = scene.settings("sensing.sensor=detector", options)
        environment = scene.environment(settings)
        replay = Replay(scene.world, passing)
        images = MissionImages(environment.inspected_world, replay, seed=0)
        images.scene_renderer = renderer
        return fly_over(environment, replay, settings, [0], "skip", image_source=images)

    renderer = SceneRenderer(scene.world)
    after, again, aboard = flown(False), flown(False), flown(True)
    assert len(after.detections) > 0
    assert after.detections == again.detections == aboard.detections
    assert after.rows == again.rows == aboard.rows


class Asked:
    """A scene renderer that notes what it is asked for and renders nothing."""

    def __init__(self) -> None:
        self.calls: list[tuple[View, object, float, int]] = []

    def picture(
        self,
        view: View,
        _camera: object,
        _light: object,
        traffic: object,
        time_s: float,
        *,
        noise: int,
        parked: ParkedVehicles,
        truth: bool,
    ) -> object:
        self.truth = truth
        self.parked = parked
        self.calls.append((view, traffic, time_s, noise))
        return None


def test_an_image_is_asked_for_with_the_captures_own_pose_motion_traffic_and_noise() -> None:
    scene = empty_street((20, 1))
    short = recording(("suv",), lambda *_: (500.0, 500.0, 0.0, 0.0), frames=201)
    longer = recording(("suv",), lambda *_: (500.0, 500.0, 0.0, 0.0), frames=401)
    replay = Replay(scene.world, short, start_s=30.0)
    parked = full_street().environment(full_street().settings(FULL)).parked
    images = MissionImages(scene.world, replay, seed=4, parked=parked)
    renderer = images.scene_renderer = Asked()
    frame = Frame(7, 12.5, (20.0, 1.0), 9.0, 0.3, find_camera("paper"), Conditions(), velocity_mps=(2.0, -1.0))
    images.rendered(frame)
    replay.recording = longer
    images.rendered(frame, (64, 48))
    images.rendered(replace(frame, number=8))
    views, traffic, times, noise = zip(*renderer.calls, strict=True)
    assert [view.size_px for view in views] == [frame.camera.image_px, (64, 48), frame.camera.image_px]
    assert tuple(views[0].velocity_mps) == (2.0, -1.0, 0.0)
    assert views[0].project((20.4, 1.2, 0.0)) == pytest.approx(frame.view.project((20.4, 1.2, 0.0)))
    assert traffic[0] is short
    assert traffic[1] is longer
    assert times == (42.5, 42.5, 42.5)
    assert noise[0] == noise[1] != noise[2]
    assert renderer.parked is parked
    assert len(parked) == 20


@pytest.mark.needs_adapter
def test_frames_at_night_are_refused_before_the_flight() -> None:
    check_frames(load_settings(), straight())
    night = load_settings(conditions={"time": "02:00"})
    with pytest.raises(PaveTwinError, match=r"`time` 02:00: on 2025-03-20 the sun .* below the horizon"):
        check_frames(night, straight())


def test_a_sheet_shows_what_was_found_missed_and_reported_falsely(tmp_path: Path) -> None:
    """Two of three potholes can be seen, and one spot is not a pothole."""
    scene = Scene(straight((12.0, 1.0), (30.0, 0.0), (45.0, 2.0)), altitude_m=10.0)
    spots: list[Spot] = [("pothole", each.polygon) for each in scene.world.defects[:2]]
    ghost: Spot = ("pothole", straight((52, 0)).defects[0].polygon)
    result, painter = fly_over_spots(scene, [*spots, ghost], aboard=False)
    sensor = DetectorSensor(result.settings.sensing, 0, SpotDetector(image_px=240))
    cells = save_mission_sheet(result, painter, sensor, tmp_path / "sheet.jpg")
    alarms = (result.detections.outcome == Outcome.FALSE_ALARM).sum()
    assert (len(result.confirmed), alarms > 0) == (2, True)
    assert cells == 3 + min(alarms, 6)
    sheet = np.asarray(Image.open(tmp_path / "sheet.jpg").convert("L"))
    rows = np.flatnonzero((sheet < 40).sum(axis=1) > CELL_PX / 2)
    first = sheet[rows[0] : rows[0] + CELL_PX]
    middle = slice(CELL_PX // 2 - 20, CELL_PX // 2 + 20)
    left = int(np.flatnonzero((first < 40).sum(axis=0) > CELL_PX / 2)[0])
    found, missed = (first[middle, left + at : left + at + CELL_PX][:, middle] for at in (0, 2 * (CELL_PX + 18)))
    assert found.mean() > 90, "the spot is in the middle of its cell"
    assert missed.mean() < 20


def test_nothing_to_show_is_no_sheet(tmp_path: Path) -> None:
    scene = Scene(straight(), altitude_m=10.0)
    result, painter = fly_over_spots(scene, [], aboard=False)
    sensor = DetectorSensor(result.settings.sensing, 0, SpotDetector(image_px=240))
    assert save_mission_sheet(result, painter, sensor, tmp_path / "sheet.jpg") == 0
    assert not (tmp_path / "sheet.jpg").exists()
