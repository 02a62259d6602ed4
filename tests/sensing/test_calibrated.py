"""The sensor `calibrated`: its chances and draws, false alarms, and missions flown with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr
from shapely import Point, box

from pavetwin.config.mission import SensingSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import fly_over
from pavetwin.mission.folder import MissionFolder
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import LOOKS, look_table, save_mission
from pavetwin.perception.model_file import model_path
from pavetwin.sensing import Outcome, Sighting
from pavetwin.sensing.calibrated import Calibrated, LookScorer
from pavetwin.sensing.fitted_sensor import DEFAULT, SensorModel, sensor_path
from pavetwin.sensing.frame import LookMeter
from pavetwin.sensing.sensor import trial_defect, trial_frames
from scenes import drawn_detector, fitted
from scenes.fitted import stated
from scenes.spots import fly_over_spots
from scenes.tiny import TRUCK, Scene, parked, straight

DEFECTS = 4000
BLANK = replace(trial_frames(1)[0], sun_elevation_deg=40.0)


def sensor(model: SensorModel | None = None, seed: int = 0) -> Calibrated:
    return Calibrated(SensingSettings(sensor="calibrated"), seed, model or stated(alarms_per_m2=0))


def seen(number: int, look: int, visible: float = 1.0) -> Sighting:
    """A look at a pothole of 0.4 m in the middle of the image, identified by its outline."""
    pothole = replace(trial_defect(2), id=number, polygon=Point(0, 0).buffer(0.2 + 1e-9 * number, quad_segs=1))
    return Sighting(pothole, visible, look, across_m=0.4)


def hits(one: Calibrated, *sightings: Sighting) -> list[bool]:
    reported = set(map(id, one.detect(replace(BLANK, sightings=sightings)).footprint))
    return [id(each.defect.polygon) in reported for each in sightings]


def test_a_look_is_measured_in_pixels_of_the_detectors_image() -> None:
    look = LookMeter(BLANK.camera.image_px[0] // 2).look(BLANK, seen(0, 0, visible=0.6))
    pixel_m = 2 * BLANK.ground_resolution_m
    assert look.size_px == pytest.approx(0.08**0.5 / pixel_m, rel=1e-3)
    assert look.pixel_mm == pytest.approx(1000 * pixel_m)
    assert look.width_px == pytest.approx(0.02 / pixel_m)
    assert look.blur_px == pytest.approx(BLANK.blur_px / 2)
    assert (look.visible_fraction, look.inside_fraction, look.off_centre) == (0.6, 1.0, pytest.approx(0.0, abs=1e-9))
    assert LookMeter().look(BLANK, seen(0, 0)).size_px == pytest.approx(2 * look.size_px)


@given(east=st.floats(-9, 9), north=st.floats(-7, 7), yaw=st.floats(-3, 3), long=st.floats(0.2, 6))
def test_the_share_within_the_image_is_that_of_the_area(east: float, north: float, yaw: float, long: float) -> None:
    shape = shapely.affinity.translate(box(-long / 2, -0.1, long / 2, 0.1), east, north)
    frame = replace(BLANK, yaw_rad=yaw)
    look = LookMeter().look(frame, replace(seen(0, 0), defect=replace(trial_defect(2), polygon=shape)))
    assert look.inside_fraction == pytest.approx(shape.intersection(frame.footprint).area / shape.area, abs=1e-9)
    corner_m = np.hypot(*BLANK.camera.image_px) * BLANK.ground_resolution_m / 2
    assert look.off_centre == pytest.approx(min(1.0, np.hypot(east, north) / corner_m), abs=1e-6)


@pytest.mark.parametrize("spread", [0.3, 2.0])
def test_each_look_has_the_chance_of_the_model_and_two_looks_its_correlation(spread: float) -> None:
    model = stated(spread=spread, level=0.6, alarms_per_m2=0)
    one = sensor(model)
    chance = model.chance(LookMeter(2048).look(BLANK, seen(0, 0)))
    found = np.array([hits(one, *(seen(number, look) for number in range(DEFECTS))) for look in range(2)])
    rng = np.random.default_rng(0)
    score = np.sqrt(1 + spread**2) * np.quantile(rng.standard_normal(10**6), chance)
    both = ((score + spread * rng.standard_normal((10**5, 1)) + rng.standard_normal((10**5, 2))) > 0).all(axis=1).mean()
    assert found.mean(axis=1) == pytest.approx([chance] * 2, abs=0.03)
    assert found.all(axis=0).mean() == pytest.approx(both, abs=0.03)


def test_a_defect_keeps_its_random_effect_whatever_else_is_looked_at_before() -> None:
    model = stated(spread=30.0, level=0.0, alarms_per_m2=0)
    first = [hits(sensor(model), seen(number, 0))[0] for number in range(60)]
    later = hits(sensor(model), *(seen(number, 7) for number in reversed(range(60))))[::-1]
    assert np.mean(np.array(first) == np.array(later)) > 0.9
    assert 10 < sum(first) < 50
    assert first != [hits(sensor(model, seed=1), seen(number, 0))[0] for number in range(60)]


def test_larger_clearer_and_more_visible_defects_are_found_more_often() -> None:
    model, meter = stated(), LookMeter(2048)
    usual = meter.look(BLANK, seen(0, 0))
    chance = model.chance(usual)
    for better in (
        usual._replace(size_px=2 * usual.size_px),
        usual._replace(width_px=2 * usual.width_px),
        usual._replace(severity="high"),
        usual._replace(blur_px=usual.blur_px - 0.1),
    ):
        assert model.chance(better) > chance
    for worse in (
        usual._replace(visible_fraction=0.5),
        usual._replace(inside_fraction=0.5),
        usual._replace(pixel_mm=2 * usual.pixel_mm),
    ):
        assert model.chance(worse) < chance
    assert model.chance(usual._replace(sun_elevation_deg=None)) == pytest.approx(chance)
    assert model.chance(usual._replace(kind="ravelling")) == 0.0


def test_false_alarms_are_as_many_as_the_model_has_and_the_same_whenever_asked() -> None:
    one = sensor(stated(alarms_per_m2=0.004))
    frames = [replace(BLANK, number=number, sightings=()) for number in range(3000)]
    counts = np.array([len(one.detect(frame)) for frame in frames])
    expected = 0.004 * BLANK.footprint.area
    assert counts.mean() == pytest.approx(expected, rel=0.1)
    assert counts.var() == pytest.approx(expected, rel=0.2)
    again = sensor(stated(alarms_per_m2=0.004))
    for number in (np.flatnonzero(counts)[[0, 5]]).tolist():
        assert again.detect(frames[number]) == one.detect(frames[number])
    alarms = one.detect(frames[int(np.flatnonzero(counts)[0])])
    assert alarms.class_name[0] == "pothole"
    ground = BLANK.footprint_of(alarms.box(0))
    assert ground.area == pytest.approx((60 * LookMeter(2048).pixel_m(BLANK)) ** 2, rel=1e-6)
    assert BLANK.footprint.buffer(1e-6).contains(ground)
    frame = frames[int(np.flatnonzero(counts)[0])]
    turned = replace(frame, yaw_rad=frame.yaw_rad + 0.7, position=(30.0, -4.0))
    places = [(frame, ground), (turned, turned.footprint_of(one.detect(turned).box(0)))]
    corners = [each.view.project(np.c_[shapely.get_coordinates(shape), np.zeros(5)]) for each, shape in places]
    assert corners[1] == pytest.approx(corners[0], abs=1e-3)


def test_the_fitted_sensor_that_ships_is_used_unless_another_is_named(tmp_path: Path) -> None:
    def opened(**options: str) -> Calibrated:
        return Calibrated(SensingSettings(sensor="calibrated", options=options), 0)

    shipped = opened()
    assert shipped.model == opened(fitted=DEFAULT).model == SensorModel.read(sensor_path(DEFAULT), model_path(DEFAULT))
    assert set(shipped.model.classes) == {"single_crack", "crocodile_crack", "pothole"}
    with pytest.raises(PaveTwinError, match=r"There is no fitted sensor '.*none.json': name one \w+ ships \("):
        opened(fitted=str(tmp_path / "none.json"))
    assert opened(fitted=str(fitted.FILE), model=str(drawn_detector.FILE)).model == stated()
    (tmp_path / "other.onnx").write_bytes(b"x")
    with pytest.raises(PaveTwinError, match="was fitted for another detector"):
        opened(fitted=str(fitted.FILE), model=str(tmp_path / "other.onnx"))


STORY = Scene(
    straight((12, 0), (30, 0), (45, -1.5)),
    (parked(30, 0, TRUCK, until_s=10), parked(14, 2, TRUCK, until_s=12)),
    altitude_m=6.0,
)


def flown(policy: str, seed: int = 0, spread: float = 1.0) -> MissionResult:
    settings = STORY.settings("sensing.sensor=calibrated", f"sensing.options={{fitted: {fitted.FILE}}}")
    eyes = Calibrated(settings.sensing, seed, stated(spread=spread))
    return fly_over(STORY.environment(settings), STORY.traffic(), settings, [0], policy, seed=seed, sensor=eyes)


def test_missions_are_flown_the_same_way_and_count_duplicates_and_false_alarms() -> None:
    result = flown("hover")
    other = fly_over(STORY.environment(STORY.settings()), STORY.traffic(), STORY.settings(), [0], "hover")
    assert result.duration_s == other.duration_s
    assert result.energy == other.energy
    (row,) = result.rows
    assert row.duplicates > 0
    assert row.false_alarms == (result.detections.outcome == Outcome.FALSE_ALARM).sum()
    assert flown("hover").detections == result.detections


@pytest.mark.parametrize("seed", [0, 1])
def test_what_a_defect_keeps_does_not_depend_on_the_policy(seed: int) -> None:
    """With a large random effect, every policy that looks at a defect finds it, or none does."""
    hover, skip = (flown(policy, seed, spread=1e4) for policy in ("hover", "skip"))
    both = {defect for _, defect, _ in hover.sighted} & {defect for _, defect, _ in skip.sighted}
    assert len(both) >= 2
    assert both & set(hover.memory.confirmed) == both & set(skip.memory.confirmed)


SPOTS = [("pothole", box(11.8, -0.2, 12.2, 0.2)), ("pothole", box(40, 1, 40.6, 1.6))]


def test_a_mission_writes_down_what_every_capture_showed_and_what_was_found(tmp_path: Path) -> None:
    result, _ = fly_over_spots(STORY, SPOTS, aboard=False)
    table = look_table(result)
    assert set(table["capture"]) == set(range(len(result.captures["t_s"])))
    looks = table.drop_nulls("defect")
    first = looks.filter(defect=0)
    assert first.height > 1
    assert first["found"].any()
    assert not looks.filter(pl.col("defect") != 0)["found"].any()
    assert looks.height == looks.unique(["capture", "defect"]).height
    confirmed = result.confirmed.capture.min()
    assert first["capture"].max() > confirmed
    assert set(table["image_px"]) == {240}
    save_mission(flown("hover"), tmp_path / "other")
    assert not (tmp_path / "other" / LOOKS).exists()


def test_looks_are_read_from_a_missions_folder(tmp_path: Path) -> None:
    result, _ = fly_over_spots(STORY, SPOTS, aboard=False)
    options = {**result.spec.settings.sensing.options, "model": str(drawn_detector.FILE)}
    sensing = result.settings.sensing.model_copy(update={"options": options})
    spec = type(result.spec).of(
        **{
            name: getattr(result.spec, name)
            for name in ("world", "defects", "traffic", "base", "targets", "policy", "seed")
        },
        settings=result.settings.model_copy(update={"sensing": sensing}),
    )
    save_mission(replace(result, spec=spec), tmp_path / "m")
    source = MissionFolder(tmp_path / "m").looks()
    assert source.detector == stated().detector.model_copy(update={"image_px": 240})
    table = look_table(result).drop_nulls("defect")
    assert source.looks["found"].to_list() == table["found"].to_list()
    assert source.looks["group"].n_unique() == table["defect"].n_unique()
    assert source.images.height == len(result.captures["t_s"])
    alarms = result.detections[result.detections.outcome == Outcome.FALSE_ALARM]
    assert source.alarms.height == len(alarms) > 0
    pixel_mm = source.images["pixel_mm"][0]
    assert source.alarms["size_px"].max() == pytest.approx(600 / pixel_mm, rel=0.2)
    (tmp_path / "m" / LOOKS).write_bytes(b"PAR1 broken")
    with pytest.raises(PaveTwinError, match=r"looks.parquet' is damaged"):
        MissionFolder(tmp_path / "m").looks()
    (tmp_path / "m" / LOOKS).unlink()
    with pytest.raises(PaveTwinError, match=r"looks.parquet' is missing; only missions of the sensor 'detector'"):
        MissionFolder(tmp_path / "m").looks()


def test_scores_in_flight_are_those_of_the_model() -> None:
    model, meter = stated(), LookMeter(640)
    scorer = LookScorer(model, meter)
    rng = np.random.default_rng(3)
    for number in range(60):
        defect = replace(trial_defect(number), kind=(*model.classes, "ravelling")[number % 4])
        long, east, north = rng.uniform(0.1, 4.0), *rng.uniform(-6, 6, 2)
        outline = shapely.affinity.translate(box(-long / 2, -0.1, long / 2, 0.1), east, north)
        sighting = Sighting(replace(defect, polygon=outline), rng.uniform(), 0, across_m=0.2)
        frame = replace(
            BLANK,
            altitude_m=(6.0, 10.0)[number % 2],
            velocity_mps=(rng.normal(0, 3), rng.normal(0, 3)),
            yaw_rad=rng.uniform(-3, 3),
            sun_elevation_deg=(None, 20.0, 50.0)[number % 3],
            sightings=(sighting,),
        )
        ((seen, score),) = scorer.scored(frame)
        assert seen is sighting
        assert ndtr(score) == pytest.approx(model.chance(meter.look(frame, sighting)), abs=1e-12)


def test_draws_are_stable() -> None:
    """48 looks at defects across and beyond the image, at all visible fractions."""
    one, found, alarms = sensor(stated(), seed=5), [], []
    for number in range(48):
        outline = shapely.affinity.translate(box(-0.1, -0.02, 0.1 + 0.02 * number, 0.2), number % 7 - 3, 2 - number % 5)
        defect = replace(trial_defect(number % 3), id=number, kind="pothole", polygon=outline)
        sighting = Sighting(defect, 1 - 0.01 * number, number % 4, across_m=0.1)
        frame = replace(BLANK, number=number, velocity_mps=(0.1 * number, 1.0), yaw_rad=0.1 * number)
        reported = one.detect(replace(frame, sightings=(sighting,)))
        found.append(any(footprint is outline for footprint in reported.footprint))
        alarms.append(int(reported.is_spurious.sum()))
    assert sum(is_found << look for look, is_found in enumerate(found)) == 193818787611322
    assert (sum(found), sum(alarms)) == (25, 71)
    assert alarms[:16] == [1, 2, 1, 3, 2, 2, 1, 1, 1, 0, 1, 2, 2, 2, 1, 2]


def test_captures_that_policies_share_have_one_name(tmp_path: Path) -> None:
    """Two missions that differ in their policy alone, and one under another light."""
    names = []
    for folder, policy in (("a", "baseline"), ("b", "hover"), ("c", "hover")):
        result, _ = fly_over_spots(STORY, SPOTS, aboard=False, policy=policy)
        if folder == "c":
            clouded = result.settings.conditions.model_copy(update={"clouds": 0.9})
            settings = result.spec.settings.model_copy(update={"conditions": clouded})
            result = replace(result, spec=result.spec.model_copy(update={"settings": settings}))
        save_mission(result, tmp_path / folder)
        names.append(MissionFolder(tmp_path / folder).looks().images["capture"].to_list())
    assert len(set(names[0])) == len(names[0])
    shared = set(names[0]) & set(names[1])
    assert shared
    assert names[0][: len(shared)] == names[1][: len(shared)], "until the policies part"
    assert not set(names[1]) & set(names[2])
