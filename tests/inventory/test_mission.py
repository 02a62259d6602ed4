"""The inventory of a mission: from what its sensor reported, without the judgement of what is there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import shapely

from pavetwin.errors import PaveTwinError
from pavetwin.files import file_sha256
from pavetwin.inventory.condition import with_detected
from pavetwin.inventory.entry import Entry, entry_of
from pavetwin.inventory.of_mission import NO_CROPS, flown
from pavetwin.inventory.reading import entries_of
from pavetwin.mission.condition import ConditionReport, street_condition, unit_table
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import DETECTIONS, MISSION, save_mission
from pavetwin.pci import Survey, sample_units
from pavetwin.perception.model_file import DEFAULT, model_path
from pavetwin.world.georeference import from_wgs84
from scenes.spots import Spot, fly_over_spots
from scenes.survey import photograph
from scenes.tiny import Scene, empty_street, straight

DEFECTS = ((12.0, 1.0), (30.0, 0.0), (30.0, -1.5), (45.0, 2.0))
GHOST = ("pothole", straight((52, 0)).defects[0].polygon)


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, MissionResult]:
    scene = Scene(straight(*DEFECTS), altitude_m=10.0)
    spots: list[Spot] = [("pothole", each.polygon) for each in scene.world.defects]
    result, painter = fly_over_spots(scene, [*spots, GHOST], aboard=False)
    folder = tmp_path_factory.mktemp("inventory") / "m"
    save_mission(result, folder)
    frames = folder / "frames" / "images"
    frames.mkdir(parents=True)
    lines = ["capture,image"]
    place = result.environment.world.georeference
    for frame in tuple(painter.asked):
        (frames / f"{frame.number}.png").write_bytes(photograph(frame, place=place))
        lines.append(f"{frame.number},images/{frame.number}.png")
    (folder / "frames" / "captures.csv").write_text("\n".join(lines) + "\n")
    return folder, result


def test_each_defect_and_each_false_alarm_is_one_entry_at_its_place(mission: tuple[Path, MissionResult]) -> None:
    folder, result = mission
    reading = flown(folder)
    assert reading.remarks == ()
    assert reading.frame is not None
    found = entries_of(reading)
    places = [from_wgs84(result.environment.world.georeference, reading.frame.to_wgs84(xy(entry))) for entry in found]
    expected = sorted([*DEFECTS, (52.0, 0.0)])
    assert np.array(sorted(map(tuple, np.round(places, 1)))) == pytest.approx(np.array(expected), abs=0.05)
    for entry in found:
        shown = shapely.intersects(reading.detections.footprint, entry.place)
        assert entry.looks == len(set(reading.detections.image[shown]))
        assert entry.sizes["area_m2"].value == pytest.approx(0.16, rel=0.25)
        assert (entry.class_name, entry.is_cut) == ("pothole", False)


def xy(entry: Entry) -> tuple[float, float]:
    assert entry.place is not None
    return entry.place.x, entry.place.y


def test_a_crop_shows_the_detection_in_its_frame(mission: tuple[Path, MissionResult]) -> None:
    """A pothole is painted in the grey 120; in the middle of the crop nothing else is."""
    reading = flown(mission[0])
    for entry in entries_of(reading):
        picture = reading.crop(entry.best)
        assert picture is not None
        middle = picture.shape[0] // 2
        assert (abs(picture[middle - 3 : middle + 3, middle - 3 : middle + 3].astype(int) - 120) < 8).all()


def test_without_frames_there_are_no_crops_and_that_is_said(tmp_path: Path) -> None:
    result = empty_street((20, 1)).fly("baseline")
    save_mission(result, tmp_path / "m")
    reading = flown(tmp_path / "m")
    assert reading.remarks == (NO_CROPS,)
    (entry,) = entries_of(reading)
    assert reading.crop(entry.best) is None
    assert entry.sizes == {}


def test_a_mission_that_found_nothing_has_an_empty_inventory(tmp_path: Path) -> None:
    save_mission(empty_street().fly("baseline"), tmp_path / "m")
    assert len(flown(tmp_path / "m").detections) == 0


def copied(folder: Path, target: Path) -> Path:
    """The description and the detections of a mission, in another folder."""
    target.mkdir(parents=True, exist_ok=True)
    for name in (MISSION, DETECTIONS):
        (target / name).write_bytes((folder / name).read_bytes())
    return target


def test_a_table_of_detections_without_a_column_is_refused(tmp_path: Path, mission: tuple[Path, MissionResult]) -> None:
    folder = copied(mission[0], tmp_path)
    pl.read_parquet(folder / DETECTIONS).drop("footprint").write_parquet(folder / DETECTIONS)
    with pytest.raises(PaveTwinError, match=r"is damaged: it has no column 'footprint'; fly"):
        flown(folder)


DAMAGED = {
    "empty": b"",
    "other words": b"hello,world\n",
    "one column": b"capture\n3\n",
    "no number": b"capture,image\nthree,images/3.png\n",
    "half a line": b"capture,image\n3\n",
    "a longer line": b"capture,image\n3,images/3.png,4\n",
    "bytes": bytes(range(128, 255)),
}


@pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_table_of_images_is_refused(
    mission: tuple[Path, MissionResult], tmp_path: Path, content: bytes
) -> None:
    folder = copied(mission[0], tmp_path)
    (folder / "frames").mkdir()
    (folder / "frames" / "captures.csv").write_bytes(content)
    with pytest.raises(PaveTwinError, match=r"captures.csv' is damaged; remove it for an inventory without crops"):
        flown(folder)


def test_columns_of_the_table_of_images_are_found_by_their_names(
    mission: tuple[Path, MissionResult], tmp_path: Path
) -> None:
    (copied(mission[0], tmp_path) / "frames").mkdir()
    lines = [line.split(",") for line in (mission[0] / "frames" / "captures.csv").read_text().split()]
    rows = [f"{mission[0]}/frames/{image},2,{capture}" for capture, image in lines[1:]]
    (tmp_path / "frames" / "captures.csv").write_text("\n".join(["image,note,capture", *rows]))
    reading = flown(tmp_path)
    assert all(reading.crop(reading.detections[[row]]) is not None for row in range(len(reading.detections)))


def test_confidence_counts_from_the_least_on(mission: tuple[Path, MissionResult]) -> None:
    reading = flown(mission[0])
    both = reading.detections[[0, 0]].with_columns(confidence=[0.5, 0.499])
    assert replace(reading, detections=both).confident(0.5) == both[[0]]


def test_the_error_of_positions_is_that_of_places(mission: tuple[Path, MissionResult]) -> None:
    first = flown(mission[0], position_error_m=3.0).detections[[0]]
    assert entry_of(1, first).place_error_m == pytest.approx(3.0, abs=0.01)
    for value in (-1.0, float("nan"), float("inf")):
        with pytest.raises(PaveTwinError, match=r"`position_error_m` .*: it must be "):
            flown(mission[0], position_error_m=value)


def test_the_condition_index_by_measured_sizes_stands_beside_the_true_one(
    mission: tuple[Path, MissionResult], tmp_path: Path
) -> None:
    """Four potholes are reported where they are, and one that is not there: the index is lower than the true one."""
    folder, result = mission
    world = result.environment.world
    survey = Survey(sample_units(world.segments), world.defects)
    report = ConditionReport(world, survey.conditions(), survey.conditions([]), {}, world.defects)
    exact = with_detected(report, replace(flown(folder, frame=world.georeference), entry_model=None))
    assert exact.detected is not None
    numbers = [sum(deduct.quantity for deduct in each.deducts) for each in exact.detected]
    assert sum(numbers) == pytest.approx(len(DEFECTS) + 1)
    assert {"pci_detected", "rating_detected"} <= set(unit_table(exact).columns)
    assert street_condition(exact)["pci_detected"].to_list() == [round(exact.pci_detected or 0.0, 1)]
    nothing = empty_street((20, 1)).fly("baseline")
    save_mission(nothing, tmp_path / "m")
    assert with_detected(report, flown(tmp_path / "m")).detected is None


def test_a_reading_names_the_model_file_of_its_detector(mission: tuple[Path, MissionResult]) -> None:
    assert flown(mission[0]).detector == file_sha256(model_path(DEFAULT))


@pytest.mark.parametrize("given", ["format: 2\n", "[]\n"])
def test_a_mission_of_another_format_is_refused(
    mission: tuple[Path, MissionResult], tmp_path: Path, given: str
) -> None:
    (copied(mission[0], tmp_path) / MISSION).write_text(given)
    with pytest.raises(PaveTwinError, match=r"mission.yaml'"):
        flown(tmp_path)
