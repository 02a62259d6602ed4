"""The contact sheet of a mission whose sensor looked at images."""

from pathlib import Path

import numpy as np
from PIL import Image

from pavetwin.capture.sheets import save_mission_sheet
from pavetwin.draw.contact_sheet import CELL_PX
from pavetwin.sensing import Outcome
from pavetwin.sensing.detector import DetectorSensor
from scenes.spots import Spot, SpotDetector, fly_over_spots
from scenes.tiny import Scene, straight


def test_a_sheet_shows_what_was_found_missed_and_reported_falsely(tmp_path: Path) -> None:
    """Two of three potholes can be seen, and one spot is no pothole."""
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
