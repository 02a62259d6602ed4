"""Studies with a sensor that looks at images: taken in the worker processes, and the same as those of one mission."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import shapely
from polars.testing import assert_frame_equal
from typer.testing import CliRunner

from pavetwin.arrays import UInt8Array
from pavetwin.capture.mission_images import MissionImages
from pavetwin.cli.experiment import app
from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects, place
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Cluster, Engine, Pool, Single
from pavetwin.experiments.fly_unit import schema
from pavetwin.experiments.metrics import DETECTED, INDEX_ERROR
from pavetwin.experiments.planning import load_worlds, plan
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import ImageSourceFactory
from pavetwin.inventory import condition
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly_over
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Frame
from pavetwin.sensing.detector import DetectorSensor
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import built, drawn_detector
from scenes.spots import SpotDetector

SENSORS = """
import numpy as np
from scipy import ndimage

from pavetwin.sensing import Detections, Sensor


class Dark(Sensor):
    '''Reports what is darker than its surroundings, from the pixels alone.'''

    every_capture = True

    def detect(self, frame):
        dark = frame.image()[:, :, 0] < 100
        if not dark.any():
            return Detections()
        found, _ = ndimage.label(dark)
        boxes = ndimage.find_objects(found)
        places = [(x.start, y.start, x.stop, y.stop) for y, x in boxes]
        return Detections(["pothole"] * len(places), 0.9, box_px=places)


class Odd(Sensor):
    '''Reports the sightings around whose middle the pixels have an odd sum: other pixels, other detections.'''

    def detect(self, frame):
        if not frame.sightings:
            return Detections()
        image = frame.image()
        return Detections.of_defects(s.defect for s in frame.sightings if self.is_odd(frame, s, image))

    def is_odd(self, frame, sighting, image):
        column, row = frame.view.project((*sighting.defect.centre.coords[0], 0.0)).astype(int)
        return image[max(row - 3, 0) : row + 4, max(column - 3, 0) : column + 4].sum() % 2 == 1
"""

CAMERA = """
small:
  title: Few pixels
  image_px: [320, 240]
  vertical_fov_deg: 60
"""


TAKEN: list[tuple[int, int]] = []
"""Capture number and number of parked vehicles of each image painted in this process."""


class Painted:
    """Images of a road on which every defect is a box in the colour that the drawn detector takes for a pothole."""

    def __init__(self, world: World, _replay: Replay, _seed: int, parked: ParkedVehicles) -> None:
        self._defects = world.defects
        self._parked = parked

    def __call__(self, frame: Frame) -> UInt8Array:
        TAKEN.append((frame.number, len(self._parked)))
        width, height = frame.camera.image_px
        image = np.full((height, width, 3), drawn_detector.ROAD, dtype=np.uint8)
        for defect in self._defects:
            left, top, right, bottom = np.round(frame.box_of(defect.polygon)).astype(int)
            image[max(0, top) : max(0, bottom), max(0, left) : max(0, right)] = drawn_detector.COLOURS["pothole"]
        return image


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("images")
    save_world(
        add_defects(built("cross"), DefectOptions(population="paper", per_segment=4, mix={"pothole": 1.0})),
        folder / "cross",
    )
    (folder / "sensors.py").write_text(SENSORS)
    (folder / "camera.yaml").write_text(CAMERA)
    return folder / "cross"


def design(world: Path, sensor: str, **values: object) -> Design:
    usual = {
        "worlds": [str(world)],
        "densities": ["low"],
        "altitudes_m": [6, 10],
        "policies": ["baseline"],
        "sensors": [f"{world.parent / 'sensors.py'}:{sensor}"],
        "presets": ["default"],
        "set": {"camera.model": str(world.parent / "camera.yaml"), "parking.enabled": False},
        "replicates": 2,
        "seed": 4,
    }
    return Design.parse(usual | values, where="the design")


def still(world: Path, sensors: list[str], **values: object) -> Design:
    """One replicate without traffic."""
    options = {"sensing.options.model": str(drawn_detector.FILE)} if "detector" in sensors else {}
    fixed = {"camera.model": str(world.parent / "camera.yaml"), "parking.enabled": False, **options}
    usual = {"densities": ["v0-p0"], "sensors": sensors, "altitudes_m": [6], "replicates": 1, "set": fixed}
    return design(world, "", **(usual | values))


@pytest.fixture(scope="module")
def both(world: Path) -> pl.DataFrame:
    """A study with a sensor that measures and one that does not."""
    chosen = still(world, ["recall", "detector"])
    return run(chosen, world.parent / "study", Single(), image_source_factory=Painted).table


def flown_alone(row: dict[str, Any], world: Path, images: ImageSourceFactory) -> MissionResult:
    """The mission of a row of the table, flown with images of its own."""
    town = load_world(world)
    settings = load_settings(
        altitude_m=row["altitude_m"],
        sensing={"sensor": row["sensor"]},
        camera={"model": str(world.parent / "camera.yaml")},
        parking={"enabled": False},
    )
    target = next(index for index, segment in enumerate(town.segments) if segment.id == row["segment"])
    options = DefectOptions(population="paper", per_segment=4, mix={"pothole": 1.0})
    environment = prepare(town, settings, place([town.segments[target]], row["defect_seed"], options))
    replay, seed = replay_of(town, "low", row["traffic_seed"]), row["sensing_seed"]
    source = images(environment.inspected_world, replay, seed, environment.parked)
    return fly_over(environment, replay, settings, [target], "baseline", seed=seed, image_source=source)


def check_alone(table: pl.DataFrame, world: Path, images: ImageSourceFactory) -> None:
    """Every row against the mission that is flown alone."""
    assert (table["status"] == "flown").all(), table["reason"].to_list()
    for row in table.iter_rows(named=True):
        (alone,) = flown_alone(row, world, images).rows
        for name in ("defects", "confirmed", "duplicates", "false_alarms", "precision", "time_s"):
            assert row[name] == getattr(alone, name), name


@pytest.mark.slow
@pytest.mark.parametrize(
    "engine",
    [pytest.param(Pool(2), id="pool"), pytest.param(Cluster(jobs=2), id="dask", marks=pytest.mark.slow)],
)
def test_a_sensor_reads_the_pixels_of_its_images_in_two_processes(world: Path, tmp_path: Path, engine: Engine) -> None:
    ran = run(design(world, "Dark", altitudes_m=[6]), tmp_path / "study", engine, image_source_factory=Painted)
    check_alone(ran.table, world, Painted)
    assert ran.table["confirmed"].sum() > 0
    assert ran.table["duplicates"].sum() > 0, "each defect is in several captures"


@pytest.mark.slow
def test_without_images_its_missions_fail_and_are_flown_again_with_them(world: Path, tmp_path: Path) -> None:
    folder = tmp_path / "study"
    ran = run(design(world, "Dark", altitudes_m=[6]), folder, Single())
    assert [reason for reason in ran.failures if "image_source" in reason]
    again = run(design(world, "Dark", altitudes_m=[6]), folder, Pool(2), image_source_factory=Painted, retry=True)
    assert not again.failures
    more = run(design(world, "Dark", altitudes_m=[6], replicates=3), folder, Pool(2), image_source_factory=Painted)
    assert more.missions_flown == 1
    at_once = run(
        design(world, "Dark", altitudes_m=[6], replicates=3), tmp_path / "other", Single(), image_source_factory=Painted
    )
    assert_frame_equal(more.table, at_once.table)


def test_images_show_the_vehicles_that_are_parked(world: Path, tmp_path: Path) -> None:
    TAKEN.clear()
    shown = {"camera.model": str(world.parent / "camera.yaml"), "parking.occupancy": 1.0}
    chosen = design(world, "Dark", altitudes_m=[6], replicates=1, set=shown)
    ran = run(chosen, tmp_path / "study", Single(), image_source_factory=Painted)
    assert not ran.failures
    assert TAKEN
    assert all(parked > 0 for _, parked in TAKEN)


@pytest.mark.slow
def test_missions_share_the_captures_that_they_have_in_common(world: Path, tmp_path: Path) -> None:
    """Without traffic all policies fly alike: the detector looks at each capture once."""
    TAKEN.clear()
    alone = run(still(world, ["detector"]), tmp_path / "alone", Single(), image_source_factory=Painted).table
    once = sorted(TAKEN)
    assert len(once) == len(set(once)) > 0
    TAKEN.clear()
    several = still(world, ["detector"], policies=["baseline", "hover", "micro", "skip"])
    ran = run(several, tmp_path / "several", Single(), image_source_factory=Painted)
    assert not ran.failures
    assert sorted(TAKEN) == once
    measured = [name for name in alone.columns if name not in ("policy", "revisits")]
    for policy in several.policies:
        assert_frame_equal(ran.table.filter(policy=policy)[measured], alone[measured])
    assert ran.table["renderer"].null_count() == 0


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_a_study_from_the_command_line_renders_the_images_that_fly_renders(world: Path, tmp_path: Path) -> None:
    text = design(world, "Odd", altitudes_m=[6]).model_dump_json()
    (tmp_path / "design.yaml").write_text(text)
    done = pavetwin("experiment", "run", tmp_path / "design.yaml", "-o", tmp_path / "study", "--jobs", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    table = Store(tmp_path / "study").table()
    check_alone(table, world, MissionImages)
    assert 0 < table["confirmed"].sum() < table["swept"].sum()


def test_a_study_whose_sensor_asks_for_no_image_loads_nothing_that_renders(world: Path, tmp_path: Path) -> None:
    (tmp_path / "design.yaml").write_text(
        design(world, "Dark", sensors=["recall"], altitudes_m=[6], replicates=1).model_dump_json()
    )
    listing = "; print('drawn by', sorted({'wgpu', 'pavetwin.render', 'pavetwin.scene.scene'} & set(sys.modules)))"
    command = ("experiment", "run", tmp_path / "design.yaml", "-o", tmp_path / "study")
    done = pavetwin(*command, then=listing)
    assert "drawn by []" in done.stdout, done.stdout + done.stderr
    assert Store(tmp_path / "study").table()["confirmed"].sum() > 0


@pytest.mark.slow
def test_the_index_by_what_was_detected_is_that_of_the_sensor_that_measures(both: pl.DataFrame) -> None:
    assert (both["status"] == "flown").all(), both["reason"].to_list()
    recall, detector = both.to_dicts()
    assert [recall[name] for name in DETECTED] == [None] * len(DETECTED)
    assert detector["confirmed"] > 0
    assert detector["pci_detected"] < 100.0
    assert detector["pci_detected_error"] == pytest.approx(detector["pci_detected"] - detector["pci"])
    assert detector[INDEX_ERROR] == abs(detector["pci_detected_error"])


@pytest.mark.slow
def test_the_command_line_recommends_by_it_and_shows_it_in_queries(world: Path, both: pl.DataFrame) -> None:
    done = CliRunner().invoke(
        app, ["recommend", str(world.parent / "study"), "--choose", "most-accurate-index", "--min-coverage", "1"]
    )
    assert done.exit_code == 0, done.output
    printed = " ".join(done.output.split())
    assert "No mission has a condition index by what was detected: their sensor measures no sizes" in printed
    value = both.filter(sensor="detector")[INDEX_ERROR].item()
    assert f"index error as detected {value:.1f} points a segment" in printed
    sql = f"select {INDEX_ERROR} from segments where sensor = 'detector'"
    asked = CliRunner().invoke(app, ["query", str(world.parent / "study"), sql, "--csv"])
    assert float(asked.output.split()[1]) == pytest.approx(value)


def test_studies_of_sensors_that_measure_nothing_have_no_such_columns(world: Path) -> None:
    measured, bare = still(world, ["recall", "detector"]), still(world, ["recall", "calibrated"])
    assert set(DETECTED) <= set(schema(plan(measured, load_worlds(measured))))
    assert not set(DETECTED) & set(schema(plan(bare, load_worlds(bare))))


@pytest.mark.slow
@pytest.mark.parametrize("error", [PaveTwinError("the model is gone"), shapely.errors.GEOSException("no ring")])
def test_a_mission_of_which_no_inventory_can_be_made_is_flown_all_the_same(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fails(_: MissionResult) -> Mapping[str, float]:
        raise error

    monkeypatch.setattr(DetectorSensor, "_opened", lambda _: SpotDetector(image_px=240))
    monkeypatch.setattr(condition, "detected_of_segments", fails)
    (row,) = run(still(world, ["detector"]), tmp_path / "s", Single(), image_source_factory=Painted).both.to_dicts()
    assert row["status"] == "flown"
    assert row["coverage"] is not None
    assert [row[name] for name in DETECTED] == [None] * len(DETECTED)
    assert row["reason"].startswith("no condition index by what was detected: ")
    assert str(error) in row["reason"]


def pavetwin(*words: object, then: str = "") -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own."""
    start = "import sys, contextlib; from pavetwin.cli import main\nwith contextlib.suppress(SystemExit): main()\n"
    script = start + then.removeprefix("; ") if then else "from pavetwin.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True, check=False, timeout=300
    )
