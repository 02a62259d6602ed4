"""Studies that are killed and go on, and traffic that cannot be recorded."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
import yaml
from polars.testing import assert_frame_equal

from pavetwin.errors import PaveTwinError
from pavetwin.experiments import fly_unit
from pavetwin.experiments.design import read_design
from pavetwin.experiments.engine import Pool, Single
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store
from pavetwin.mission.replay import grown_s
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder
from pavetwin.traffic.recording_file import load_recording, save_recording
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world
from scenes.folders import digests
from scenes.studies import small


def test_progress_is_reported_before_the_first_mission(world: Path, tmp_path: Path) -> None:
    reported: list[str] = []
    run(small(world, replicates=1), tmp_path / "study", Pool(2), on_progress=lambda _share, what: reported.append(what))
    assert [what for what in reported if "lying missions" not in what] == [
        "Planning: where to fly over cross at 6 m",
        "Planning: where to fly over cross at 10 m",
        "Starting 2 processes",
    ]
    assert reported[3:5] == [f"Recording traffic {recorded}/2, flying missions 0/8" for recorded in (0, 1)]
    assert reported[-1] == "Flying missions 8/8"


def test_traffic_that_cannot_be_recorded_fails_its_missions_only(
    reference: Path, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def badly(inputs: Inputs) -> Recorder:
        if inputs.asked is not None and inputs.asked.name == "medium":
            raise PaveTwinError("SUMO had a bad day.")
        return Recorder(inputs)

    monkeypatch.setattr(fly_unit, "Recorder", badly)
    ran = run(small(world), tmp_path / "study", Single())
    assert dict(ran.failures) == {"SUMO had a bad day.": 12}
    assert_frame_equal(ran.table.filter(traffic="low"), Store(reference).table().filter(traffic="low"))


@pytest.mark.slow
@pytest.mark.parametrize("kills", [2, 20])
def test_killed_at_many_moments_and_resumed_it_is_the_same_study(
    reference: Path, world: Path, tmp_path: Path, kills: int
) -> None:
    """Half of them after some seconds, while it reads, records or flies its first; half some moments after another part
    was written. Every third time its recordings are gone, so that it records again."""
    folder, moments = tmp_path / "study", random.Random(1)
    path = tmp_path / "design.yaml"
    path.write_text(yaml.safe_dump(small(world).model_dump(mode="json")))
    arguments = ["experiment", "run", str(path), "-o", str(folder), "--jobs", "2"]
    killed = 0
    while killed < kills:
        if killed % 3 == 0:
            for file in traffic_of(world).glob("*.parquet"):
                file.unlink()
        for part in _parts(folder)[2:]:  # so that there is always something left to be killed in
            part.unlink()
        before = len(_parts(folder))
        command = [sys.executable, "-c", "from pavetwin.cli import main; main()", *arguments]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        if killed % 2:
            time.sleep(moments.uniform(0.3, 4.0))
        else:
            while len(_parts(folder)) == before and process.poll() is None:
                time.sleep(0.01)
            time.sleep(moments.uniform(0.0, 0.5))
        process.kill()
        killed += process.wait() == -signal.SIGKILL
        for part in _parts(folder):
            pl.read_parquet(part)
    assert _parts(folder) != []
    run(read_design(path), folder, Single())
    assert digests(folder) == digests(reference)
    assert [each.name for each in tmp_path.iterdir() if each.name.startswith(".")] == []


@pytest.mark.slow
def test_what_is_kept_of_the_traffic_does_not_depend_on_kills(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fly_unit, "RECORDED_S", 10.0)
    traffic, design = traffic_of(world), small(world, replicates=1)
    for file in traffic.glob("*.parquet"):
        file.unlink()
    run(design, tmp_path / "whole", Single())
    kept = digests(traffic)
    for left_s in (10.0, grown_s(10.0)):  # by a kill before and after a recording was extended
        for file in traffic.glob("*.parquet"):
            recording = load_recording(file)
            assert recording.duration_s > left_s
            save_recording(recording.until(left_s), file)
        run(design, tmp_path / f"killed at {left_s}", Single())
        assert digests(traffic) == kept
        assert digests(tmp_path / f"killed at {left_s}") == digests(tmp_path / "whole")


def traffic_of(world: Path) -> Path:
    return cached(load_world(world), "traffic")


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / "segments.parquet").glob("w*.parquet"))
