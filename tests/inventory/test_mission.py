"""The inventory of a mission: from what its sensor reported, without the judgement of what is there."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.inventory.entry import Entry, entry_of
from pavetwin.inventory.merging import merged
from pavetwin.inventory.of_mission import NO_CROPS, flown
from pavetwin.inventory.reading import Reading
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.results import save_mission
from pavetwin.world.georeference import from_wgs84
from scenes.spots import Spot, fly_over_spots
from scenes.survey import photograph
from scenes.tiny import Scene, empty_street, straight

DEFECTS = ((12.0, 1.0), (30.0, 0.0), (30.0, -1.5), (45.0, 2.0))
GHOST = ("Pothole", straight((52, 0)).defects[0].polygon)


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, MissionResult]:
    scene = Scene(straight(*DEFECTS), altitude_m=10.0)
    spots: list[Spot] = [("Pothole", each.polygon) for each in scene.world.defects]
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


def entries_of(reading: Reading) -> list[Entry]:
    groups = merged(reading.observations)
    return [entry_of(at, [reading.observations[index] for index in group]) for at, group in enumerate(groups, 1)]


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
        assert entry.looks == len({each.image for each in reading.observations if overlaps(each, entry)})
        assert entry.sizes["area_m2"].value == pytest.approx(0.16, rel=0.25)
        assert (entry.kind, entry.is_cut) == ("Pothole", False)


def xy(entry: Entry) -> tuple[float, float]:
    assert entry.place is not None
    return entry.place.x, entry.place.y


def overlaps(observation: object, entry: Entry) -> bool:
    return bool(observation.footprint.intersects(entry.place))  # type: ignore[attr-defined]


def test_a_crop_shows_the_detection_in_its_frame(mission: tuple[Path, MissionResult]) -> None:
    """A pothole is painted in the grey 120; in the middle of the crop nothing else is."""
    for entry in entries_of(flown(mission[0])):
        assert entry.best.crop is not None
        picture = entry.best.crop()
        assert picture is not None
        middle = picture.shape[0] // 2
        assert (abs(picture[middle - 3 : middle + 3, middle - 3 : middle + 3].astype(int) - 120) < 8).all()


def test_without_frames_there_are_no_crops_and_that_is_said(tmp_path: Path) -> None:
    result = empty_street((20, 1)).fly("baseline")
    save_mission(result, tmp_path / "m")
    reading = flown(tmp_path / "m")
    assert reading.remarks == (NO_CROPS,)
    (entry,) = entries_of(reading)
    assert entry.best.crop is None
    assert entry.sizes == {}


def test_a_mission_that_found_nothing_has_an_empty_inventory(tmp_path: Path) -> None:
    save_mission(empty_street().fly("baseline"), tmp_path / "m")
    assert flown(tmp_path / "m").observations == ()


def test_a_mission_of_an_earlier_version_is_refused(tmp_path: Path, mission: tuple[Path, MissionResult]) -> None:
    pl.read_parquet(mission[0] / "detections.parquet").drop("footprint").write_parquet(tmp_path / "detections.parquet")
    with pytest.raises(PaveTwinError, match=r"is of an earlier version \(it has no column 'footprint'\); fly"):
        flown(tmp_path)
