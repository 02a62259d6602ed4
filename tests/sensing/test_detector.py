"""The sensor `detector`, with a stand-in whose answers are known: places and sizes on the ground, outcomes, and the two
ways of flying with it."""

import shutil
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon, box

from pavetwin.config.mission import PolicySettings, SensingSettings
from pavetwin.detections import SIZES
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import fly_over
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.saving import detections_table, save_mission
from pavetwin.perception.model_file import shipped_models
from pavetwin.policies import Action, GoOn, Policy, Wait
from pavetwin.sensing import Frame, Outcome
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.sensing.sensor import trial_frames
from pavetwin.twin import Snapshot
from pavetwin.world.georeference import from_wgs84
from scenes import drawn_detector
from scenes.spots import Painter, Spot, SpotDetector, fly_over_spots
from scenes.tiny import TRUCK, Scene, parked, straight

POTHOLE = box(29.8, -0.2, 30.2, 0.2)
"""The outline of `straight((30, 0))`'s."""


def sensing(aboard: bool = False, **options: float) -> SensingSettings:
    return SensingSettings(sensor="detector", options={"aboard": aboard, **options})


def sensor(detector: SpotDetector | None = None, **options: float) -> DetectorSensor:
    return DetectorSensor(sensing(**options), 0, detector or SpotDetector())


def capture(*spots: Spot, at: tuple[float, float] = (30.0, 0.0), yaw_rad: float = 0.0) -> Frame:
    """From 10 m; the image of 640 pixels across covers 15.4 m, 24.1 mm a pixel."""
    frame = trial_frames(1)[0]
    return replace(frame, position=at, yaw_rad=yaw_rad, altitude_m=10.0, source=Painter(spots))


def test_a_detection_lies_where_the_spot_does_and_has_its_sizes() -> None:
    crack = shapely.affinity.rotate(box(28.0, -0.1, 31.0, 0.1), 25)
    frame = capture(("pothole", Point(33, 2).buffer(0.5)), ("single_crack", crack), yaw_rad=0.7)
    found = sensor().detect(frame)
    assert sorted(found.class_name) == ["pothole", "single_crack"]
    pothole, line = (list(found.class_name).index(name) for name in ("pothole", "single_crack"))
    outline = found.footprint[line]
    assert found.footprint[pothole].centroid.distance(Point(33, 2)) < 0.02
    assert outline.intersection(crack).area > 0.8 * outline.union(crack).area
    assert found.pixel_mm == pytest.approx(24.1, abs=0.1)
    assert found.area_m2[pothole] == pytest.approx(pi * 0.25, rel=0.06)
    assert found.length_m[line] == pytest.approx(3.0, rel=0.1)
    assert not found.is_cut.any()
    assert found.box_px[pothole] == pytest.approx(frame.box_of(Point(33, 2).buffer(0.5)), abs=4)


def test_without_a_mask_the_box_is_the_footprint_and_nothing_is_measured() -> None:
    found = sensor(SpotDetector(masks=False)).detect(capture(("pothole", POTHOLE)))
    assert found.footprint[0].symmetric_difference(POTHOLE).area < 0.2 * POTHOLE.area
    assert np.isnan([getattr(found, name) for name in SIZES]).all()
    assert found.severity.tolist() == [""]


def test_an_object_at_the_border_is_marked_as_cut() -> None:
    found = sensor().detect(capture(("single_crack", box(10, -0.1, 31, 0.1))))
    assert found.is_cut.tolist() == [True]


@pytest.mark.parametrize(
    ("options", "detector", "size"),
    [
        ({}, SpotDetector(), (640, 479)),
        ({"image_px": 320}, SpotDetector(), (320, 239)),
        ({}, SpotDetector(tiled=True), (1270, 950)),
    ],
)
def test_images_have_the_pixels_that_the_model_takes(
    options: dict[str, float], detector: SpotDetector, size: tuple[int, int]
) -> None:
    frame = capture()
    sensor(detector, **options).detect(frame)
    assert isinstance(frame.source, Painter)
    assert [each.camera.image_px for each in frame.source.asked] == [size]


@given(
    x=st.floats(0, 1270),
    y=st.floats(0, 950),
    yaw_rad=st.floats(-7, 7),
    altitude_m=st.floats(3, 100),
    east=st.floats(-1e4, 1e4),
    north=st.floats(-1e4, 1e4),
)
def test_from_pixel_to_ground_and_back(
    x: float, y: float, yaw_rad: float, altitude_m: float, east: float, north: float
) -> None:
    frame = replace(trial_frames(1)[0], position=(east, north), yaw_rad=yaw_rad, altitude_m=altitude_m)
    ground = frame.view.ground((x, y))
    assert frame.view.project((*ground, 0.0)) == pytest.approx((x, y), abs=1e-5)
    middle = frame.view.ground((635.0, 475.0))
    away_px = np.hypot(x - 635.0, y - 475.0)
    assert np.hypot(*(ground - middle)) == pytest.approx(away_px * frame.ground_resolution_m, abs=1e-6)


GHOST = ("pothole", box(40, 1, 40.6, 1.6))
PERSON = ("person", box(35, -2, 35.5, -1.5))


@pytest.mark.parametrize("aboard", [True, False])
def test_hits_duplicates_false_alarms_and_misses_are_counted(aboard: bool) -> None:
    scene = Scene(straight((30, 0), (50, 0)), altitude_m=10.0)
    result, painter = fly_over_spots(scene, [("pothole", POTHOLE), GHOST, PERSON], aboard=aboard)
    (row,) = result.rows
    assert (row.defects, row.confirmed) == (2, 1)
    shown = sum(each.footprint.intersects(GHOST[1]) for each in painter.asked)
    of = {outcome: result.detections[result.detections.outcome == outcome] for outcome in Outcome}
    assert of[Outcome.CONFIRMED].defect.tolist() == [0]
    assert row.duplicates == len(of[Outcome.DUPLICATE]) > 0
    assert 0 < row.false_alarms <= shown
    ignored = of[Outcome.IGNORED]
    assert ((ignored.class_name == "person") | (ignored.defect == 0)).all()
    seen_m2 = row.surface_coverage * row.area_m2
    assert row.false_alarms_per_100_m2 == pytest.approx(100 * row.false_alarms / seen_m2)
    assert len(painter.asked) == len({each.number for each in painter.asked}) == len(result.captures["t_s"])


STORY = Scene(
    straight((12, 0), (30, 0), (45, -1.5)),
    (parked(30, 0, TRUCK, until_s=10), parked(14, 2, TRUCK, until_s=12)),
    altitude_m=6.0,
)


@pytest.mark.parametrize("policy", ["baseline", "hover", "skip", "micro"])
def test_aboard_and_after_landing_find_the_same(policy: str) -> None:
    spots: list[Spot] = [("pothole", each.polygon) for each in STORY.world.defects]
    spots += [GHOST]
    (aboard, _), (after, _) = (fly_over_spots(STORY, spots, aboard=way, policy=policy) for way in (True, False))
    assert after.rows == aboard.rows
    assert after.detections == aboard.detections
    assert after.memory == aboard.memory
    assert after.energy == aboard.energy
    assert Outcome.CONFIRMED in after.detections.outcome


class Reader(Policy):
    """Waits while nothing is found."""

    def decide(self, snapshot: Snapshot) -> Action:
        return GoOn() if snapshot.memory.confirmed or snapshot.time_s > 20 else Wait(2.0)


def test_a_policy_knows_what_was_found_aboard_only() -> None:
    spots: list[Spot] = [("pothole", STORY.world.defects[0].polygon)]
    reader = Reader(PolicySettings())
    (aboard, _), (after, _) = (fly_over_spots(STORY, spots, aboard=way, policy=reader) for way in (True, False))
    nothing, _ = fly_over_spots(STORY, [], aboard=True, policy=reader)
    assert aboard.duration_s < after.duration_s
    assert after.duration_s == nothing.duration_s
    assert set(after.memory.confirmed) == {0}


def test_a_failure_after_landing_is_one_line() -> None:
    def broken(_: Frame) -> np.ndarray:
        raise RuntimeError("no light")

    settings = STORY.settings("sensing.sensor=detector")
    eyes = DetectorSensor(settings.sensing, 0, SpotDetector())
    with pytest.raises(PaveTwinError, match=r"The sensor 'detector' failed after landing: RuntimeError: no light"):
        fly_over(STORY.environment(settings), STORY.traffic(), settings, [0], sensor=eyes, image_source=broken)


def test_a_changed_model_file_is_refused(tmp_path: Path) -> None:
    model = tmp_path / "model.onnx"
    shutil.copyfile(drawn_detector.FILE, model)
    scene = Scene(straight((30, 0)), altitude_m=10.0)
    options = f"sensing.options={{model: {model}, image_px: 64}}"
    settings = scene.settings("sensing.sensor=detector", options)
    result = fly_over(scene.environment(settings), scene.traffic(), settings, [0], image_source=Painter([]))
    save_mission(result, tmp_path / "m")
    assert MissionFolder(tmp_path / "m").spec.settings.sensing.sensor == "detector"
    model.write_bytes(model.read_bytes() + b"\0")
    with pytest.raises(PaveTwinError, match=r"have changed: '.*model.onnx' has changed"):
        _ = MissionFolder(tmp_path / "m").spec


def test_what_was_measured_is_in_the_table_of_detections() -> None:
    scene = Scene(straight((30, 0)), altitude_m=10.0)
    result, _ = fly_over_spots(scene, [("pothole", POTHOLE), PERSON], aboard=False)
    table = detections_table(result)
    holes = table.filter(pl.col("class") == "pothole", ~pl.col("is_cut"))
    assert holes["area_m2"].to_list() == pytest.approx([0.16] * len(holes), rel=0.2)
    assert holes["pixel_mm"][0] == pytest.approx(1000 * 2 * 10 * np.tan(pi / 6) / 180, rel=1e-6)
    lonlat = shapely.from_wkb(holes["footprint"][0]).centroid
    world = result.environment.world
    assert from_wgs84(world.georeference, (lonlat.x, lonlat.y)) == pytest.approx((30, 0), abs=0.05)
    people = table.filter(pl.col("class") == "person")
    assert people["area_m2"].null_count() == len(people) > 0


def test_unless_a_model_is_named_one_that_ships_is_used() -> None:
    assert DetectorSensor(sensing(), 0).options["model"] in shipped_models()
    with pytest.raises(PaveTwinError, match=r"There is no model 'none-1': name one that ships \(photographs"):
        DetectorSensor(sensing(model="none-1"), 0)


def test_an_exported_model_is_opened_and_finds_what_is_drawn() -> None:
    found = DetectorSensor(sensing(model=str(drawn_detector.FILE)), 0)  # type: ignore[arg-type]
    frame = trial_frames(1)[0]
    width, height = frame.camera.image_px
    drawn = drawn_detector.drawn((width, height), ("pothole", (600, 400, 660, 440)))
    seen = found.detect(replace(frame, source=lambda _: np.asarray(drawn)))
    assert seen.class_name.tolist() == ["pothole"]
    assert seen.box(0) == pytest.approx((600, 400, 660, 440), abs=1)
    assert isinstance(seen.footprint[0], Polygon)
