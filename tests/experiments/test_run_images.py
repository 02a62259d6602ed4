"""Studies with a sensor that looks at images: taken in the worker processes, and the same as those of one mission."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from pavetwin.capture.mission_images import MissionImages
from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects, place
from pavetwin.experiments.design import Design
from pavetwin.experiments.engine import Cluster, Engine, Pool, Single
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import ImageSourceFactory
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly_over
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.mission.result import MissionResult
from pavetwin.sensing import Frame
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.world.model import World
from pavetwin.world.store import load_world, save_world
from scenes import built, drawn_detector

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
"""Of every image that was painted in this process: the capture's number, and how many vehicles were parked."""


class Painted:
    """Images of grey ground on which every defect is a black box: what they show depends on the world and the pose."""

    def __init__(self, world: World, _replay: Replay, _seed: int, parked: ParkedVehicles) -> None:
        self._defects = world.defects
        self._parked = parked

    def __call__(self, frame: Frame) -> np.ndarray[Any, np.dtype[np.uint8]]:
        TAKEN.append((frame.number, len(self._parked)))
        width, height = frame.camera.image_px
        image = np.full((height, width, 3), 128, dtype=np.uint8)
        for defect in self._defects:
            left, top, right, bottom = np.round(frame.box_of(defect.polygon)).astype(int)
            image[top:bottom, left:right] = 0
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
    values: dict[str, Any] = {
        "densities": ["v0-p0"],
        "sensors": ["detector"],
        "altitudes_m": [6],
        "replicates": 1,
        "set": {
            "camera.model": str(world.parent / "camera.yaml"),
            "parking.enabled": False,
            "sensing.options.model": str(drawn_detector.FILE),
        },
    }
    TAKEN.clear()
    alone = run(design(world, "", **values), tmp_path / "alone", Single(), image_source_factory=Painted).table
    once = sorted(TAKEN)
    assert len(once) == len(set(once)) > 0
    TAKEN.clear()
    several = design(world, "", **values, policies=["baseline", "hover", "micro", "skip"])
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
    tell = "; print('drawn by', sorted({'wgpu', 'pavetwin.render', 'pavetwin.scene.scene'} & set(sys.modules)))"
    command = ("experiment", "run", tmp_path / "design.yaml", "-o", tmp_path / "study")
    done = pavetwin(*command, then=tell)
    assert "drawn by []" in done.stdout, done.stdout + done.stderr
    assert Store(tmp_path / "study").table()["confirmed"].sum() > 0


def pavetwin(*words: object, then: str = "") -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own."""
    start = "import sys, contextlib; from pavetwin.cli import main\nwith contextlib.suppress(SystemExit): main()\n"
    script = start + then.removeprefix("; ") if then else "from pavetwin.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, words)], capture_output=True, text=True, check=False, timeout=300
    )
