"""A study with a sensor that measures and one that does not, flown as a user flies it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import shapely
from typer.testing import CliRunner

from pavetwin.arrays import UInt8Array
from pavetwin.cli.experiment import app
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Single
from pavetwin.experiments.fly_unit import schema
from pavetwin.experiments.metrics import DETECTED, INDEX_ERROR
from pavetwin.experiments.planning import load_worlds, plan
from pavetwin.experiments.run import run
from pavetwin.inventory import condition
from pavetwin.mission.replay import Replay
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Frame
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import World
from pavetwin.world.store import save_world
from scenes import built, drawn_detector
from scenes.spots import SpotDetector

CAMERA = "small:\n  title: Few pixels\n  image_px: [320, 240]\n  vertical_fov_deg: 60\n"


class Painted:
    """Images of a road on which every defect is a box in the colour that the drawn detector takes for a pothole."""

    def __init__(self, world: World, _replay: Replay, _seed: int, _parked: ParkedVehicles) -> None:
        self._defects = world.defects

    def __call__(self, frame: Frame) -> UInt8Array:
        width, height = frame.camera.image_px
        image = np.full((height, width, 3), drawn_detector.ROAD, dtype=np.uint8)
        for defect in self._defects:
            left, top, right, bottom = np.round(frame.box_of(defect.polygon)).astype(int)
            image[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = drawn_detector.COLOURS["pothole"]
        return image


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("detected")
    potholes = DefectOptions(population="paper", per_segment=6, mix={"pothole": 1.0})
    save_world(add_defects(built("cross"), potholes), folder / "cross")
    (folder / "camera.yaml").write_text(CAMERA)
    return folder


@pytest.fixture(scope="module")
def table(folder: Path) -> pl.DataFrame:
    chosen = design(folder, ["recall", "detector"])
    return run(chosen, folder / "study", Single(), image_source_factory=Painted).table


def design(folder: Path, sensors: list[str]) -> Design:
    options = {"sensing.options.model": str(drawn_detector.FILE)} if "detector" in sensors else {}
    values: dict[str, Any] = {
        **{"worlds": [str(folder / "cross")], "densities": ["v0-p0"], "altitudes_m": [6], "policies": ["baseline"]},
        **{"sensors": sensors, "presets": ["default"], "replicates": 1, "seed": 4},
        "set": {"camera.model": str(folder / "camera.yaml"), "parking.enabled": False, **options},
    }
    return Design.parse(values, where="the design")


@pytest.mark.slow
def test_the_index_by_what_was_detected_is_that_of_the_sensor_that_measures(table: pl.DataFrame) -> None:
    assert (table["status"] == "flown").all(), table["reason"].to_list()
    recall, detector = table.to_dicts()
    assert [recall[name] for name in DETECTED] == [None] * len(DETECTED)
    assert detector["confirmed"] > 0
    assert detector["pci_detected"] < 100.0
    assert detector["pci_detected_error"] == pytest.approx(detector["pci_detected"] - detector["pci"])
    assert detector[INDEX_ERROR] == abs(detector["pci_detected_error"])


@pytest.mark.slow
def test_the_command_line_recommends_by_it_and_shows_it_in_queries(folder: Path, table: pl.DataFrame) -> None:
    done = CliRunner().invoke(
        app, ["recommend", str(folder / "study"), "--choose", "most-accurate-index", "--min-coverage", "1"]
    )
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "No mission has a condition index by what was detected: their sensor measures no sizes" in said
    value = table.filter(sensor="detector")[INDEX_ERROR].item()
    assert f"index error as detected {value:.1f} points a segment" in said
    sql = f"select {INDEX_ERROR} from segments where sensor = 'detector'"
    asked = CliRunner().invoke(app, ["query", str(folder / "study"), sql, "--csv"])
    assert float(asked.output.split()[1]) == pytest.approx(value)


def test_studies_of_sensors_that_measure_nothing_have_no_such_columns(folder: Path) -> None:
    both, bare = design(folder, ["recall", "detector"]), design(folder, ["recall", "calibrated"])
    assert set(DETECTED) <= set(schema(plan(both, load_worlds(both))))
    assert not set(DETECTED) & set(schema(plan(bare, load_worlds(bare))))


@pytest.mark.slow
@pytest.mark.parametrize("error", [PaveTwinError("the model is gone"), shapely.errors.GEOSException("no ring")])
def test_a_mission_of_which_no_inventory_can_be_made_is_flown_all_the_same(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fails(_: MissionResult) -> Mapping[str, float]:
        raise error

    monkeypatch.setattr(DetectorSensor, "_opened", lambda _: SpotDetector(image_px=240))
    monkeypatch.setattr(condition, "detected_of_segments", fails)
    (row,) = run(design(folder, ["detector"]), tmp_path / "s", Single(), image_source_factory=Painted).table.to_dicts()
    assert row["status"] == "flown"
    assert row["coverage"] is not None
    assert [row[name] for name in DETECTED] == [None] * len(DETECTED)
    assert row["reason"].startswith("no condition index by what was detected: ")
    assert str(error) in row["reason"]


def test_the_command_line_refuses_a_study_without_these_columns_in_one_line(folder: Path, tmp_path: Path) -> None:
    bare = run(design(folder, ["recall"]), tmp_path / "s", Single()).table
    assert not set(DETECTED) & set(bare.columns)
    asked = ["recommend", str(tmp_path / "s"), "--choose", "most-accurate-index", "--min-coverage", "1"]
    done = CliRunner().invoke(app, asked)
    assert isinstance(done.exception, PaveTwinError)
    assert "no mission has a condition index of its detections" in str(done.exception)
    assert "\n" not in str(done.exception)
