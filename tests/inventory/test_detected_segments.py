"""The condition index of segments by what a mission's sensor detected and measured, in scenes with known answers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.inventory.condition import detected_of_segments, with_detected
from pavetwin.inventory.of_mission import flown, reported
from pavetwin.mission.condition import ConditionReport
from pavetwin.mission.fly import fly_over
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import save_mission
from pavetwin.pci import Survey, mean_pci, measured_conditions, sample_units
from pavetwin.perception.detector import Detector
from pavetwin.sensing.detector import DetectorSensor
from scenes import drawn_detector
from scenes.observed import entry_of, observed
from scenes.spots import Painter, Spot, SpotDetector, fly_over_spots
from scenes.tiny import Scene, straight

DEFECTS = ((12.0, 1.0), (22.0, 0.0), (38.0, -1.5), (45.0, 2.0))
"""Two in each of the street's sample units."""
GHOST: Spot = ("pothole", straight((52, 0)).defects[0].polygon)


def seen(*ghosts: Spot, count: int = len(DEFECTS)) -> tuple[Scene, MissionResult]:
    """A street with four potholes, and a flight whose detector finds the first `count` of them exactly, and ghosts.

    It is nearly certain of them, so that entries of a few pixels are likely ones whatever sensor ships.
    """
    scene = Scene(straight(*DEFECTS), altitude_m=10.0)
    spots: list[Spot] = [("pothole", each.polygon) for each in scene.world.defects[:count]]
    return scene, fly_over_spots(scene, [*spots, *ghosts], aboard=False, confidence=0.99)[0]


def by_hand(scene: Scene, result: MissionResult, spots: Sequence[Spot]) -> float:
    """The index of potholes whose depth nobody measured: each counts in part under every severity, as frequent as these
    are among the defects that the sensor was fitted to."""
    model = reported(result).entry_model
    assert model is not None
    entries = [entry_of(1, [observed("pothole", 0.9, "1", shape)]) for _, shape in spots]
    defects = [replace(entry, severity_weights=model.severities["pothole"]) for entry in entries]
    return mean_pci(measured_conditions(sample_units(scene.world.segments[:1]), defects))


def test_potholes_that_are_all_found_give_the_index_of_a_survey_by_hand() -> None:
    scene, result = seen()
    (segment,) = (row.segment for row in result.rows)
    index = detected_of_segments(result)
    spots: list[Spot] = [("pothole", each.polygon) for each in scene.world.defects]
    assert index == {segment: pytest.approx(by_hand(scene, result, spots))}
    assert index[segment] < 80


def test_what_is_missed_raises_the_index_and_what_is_imagined_lowers_it() -> None:
    results = seen()[1], seen(count=2)[1], seen(GHOST)[1]
    (exact,), (missed,), (imagined,) = (detected_of_segments(result).values() for result in results)
    assert imagined < exact - 3
    assert missed > exact + 3


def test_a_road_on_which_nothing_is_detected_is_without_distress() -> None:
    """Whatever is there: an agency that gets no entry files 100."""
    _, result = seen(count=0)
    assert [*detected_of_segments(result).values()] == [100.0]
    assert result.rows[0].pci < 90


def test_it_is_what_the_missions_folder_tells(tmp_path: Path) -> None:
    _, result = seen(GHOST)
    save_mission(result, tmp_path / "m")
    world = result.environment.world
    survey = Survey(sample_units(world.segments[:1]), world.defects)
    report = with_detected(
        ConditionReport(world, survey.conditions(), None, {}, world.defects),
        flown(tmp_path / "m", frame=world.georeference),
    )
    assert report.pci == pytest.approx(result.rows[0].pci)
    assert [*detected_of_segments(result).values()] == pytest.approx([report.pci_detected])
    _, nothing = seen(count=0)
    save_mission(nothing, tmp_path / "n")
    assert with_detected(report, flown(tmp_path / "n", frame=world.georeference)).pci_detected == 100.0


def test_a_detector_without_masks_measures_no_sizes_and_has_no_index() -> None:
    scene = Scene(straight(*DEFECTS), altitude_m=10.0)
    settings = scene.settings("sensing.sensor=detector")
    eyes = DetectorSensor(settings.sensing, 0, SpotDetector(image_px=240, masks=False))
    images = Painter([("pothole", each.polygon) for each in scene.world.defects])
    environment = scene.environment(settings)
    result = fly_over(environment, scene.traffic(), settings, [0], "hover", sensor=eyes, image_source=images)
    assert result.rows[0].confirmed == len(DEFECTS)
    assert detected_of_segments(result) == {}


@pytest.mark.parametrize(("masks", "index"), [(True, 100.0), (False, None)])
def test_a_mission_that_reports_nothing_has_an_index_where_its_model_gives_masks(
    masks: bool, index: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, nothing = seen(count=0)
    save_mission(nothing, tmp_path / "m")
    world = nothing.environment.world
    survey = Survey(sample_units(world.segments[:1]), world.defects)
    report = ConditionReport(world, survey.conditions(), None, {}, world.defects)
    model = SpotDetector(masks=masks)
    monkeypatch.setattr(DetectorSensor, "_opened", lambda _: model)
    assert with_detected(report, flown(tmp_path / "m", frame=world.georeference)).pci_detected == index
    eyes = DetectorSensor(nothing.settings.sensing, 0)
    assert eyes.measures_sizes == masks, "which studies ask"
    assert DetectorSensor.measures_sizes


def test_a_mission_whose_sensor_cannot_be_asked_has_no_index_where_it_reports_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(_: DetectorSensor) -> None:
        raise PaveTwinError("there is no such model")

    _, nothing = seen(count=0)
    save_mission(nothing, tmp_path / "m")
    monkeypatch.setattr(DetectorSensor, "_opened", gone)
    assert not flown(tmp_path / "m").is_measured


def test_a_model_file_says_whether_it_gives_masks() -> None:
    detector = Detector(drawn_detector.FILE)
    assert detector.gives_masks
    detector.facts = replace(detector.facts, mask_px=0)
    assert not detector.gives_masks
