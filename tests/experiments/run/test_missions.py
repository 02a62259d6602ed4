"""Studies: the same table from every engine, a row for each mission, and failures that stop nothing."""

import multiprocessing
import os
import shutil
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects, place
from pavetwin.errors import PaveTwinError
from pavetwin.experiments import fly_unit
from pavetwin.experiments.engine import DIED, Cluster, Engine, Listener, Pool, Single
from pavetwin.experiments.metrics import metrics_in
from pavetwin.experiments.report.page import write_report
from pavetwin.experiments.report.study import gather
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store
from pavetwin.experiments.units import Plan, Unit
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly, fly_over
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.replay import Replay, replay_of
from pavetwin.traffic.record import record
from pavetwin.traffic.recording_file import save_recording
from pavetwin.world.store import load_world, save_world
from scenes import built, damaged
from scenes.folders import digests
from scenes.parking import save_cross_with_rows, with_places
from scenes.studies import small

DEADLY = """
import multiprocessing, os
from pavetwin.policies import GoOn, Policy

class Deadly(Policy):
    name = "deadly"

    def decide(self, snapshot):
        if multiprocessing.parent_process() is not None:
            os._exit(9)
        return GoOn()
"""


def test_every_mission_is_a_row_with_its_factors_and_seeds(reference: Path) -> None:
    table = Store(reference).table()
    assert table.height == 2 * 2 * 2 * 3
    assert table.select("traffic", "altitude_m", "policy", "replicate").n_unique() == table.height
    assert (table["status"] == "flown").all()
    assert table["traffic"].unique(maintain_order=True).to_list() == ["low", "medium"]
    assert (table["coverage"] * table["defects"] - table["confirmed"]).abs().max() < 1e-9
    assert table["time_s"].min() > 5


@pytest.fixture(scope="module")
def lined(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cross with a row of parking places on the carriageway of every segment."""
    return save_cross_with_rows(tmp_path_factory.mktemp("lined") / "cross", 6)


def test_a_study_sweeps_how_full_the_streets_are(lined: Path, tmp_path: Path) -> None:
    design = small(
        lined, densities=["low"], altitudes_m=[6], replicates=2, presets=["default"],
        sweep={"parking.occupancy": [0.0, 1.0]},
    )  # fmt: skip
    run(design, tmp_path / "study", Single())
    table = Store(tmp_path / "study").table()
    assert (table["status"] == "flown").all()
    hidden = table.select("replicate", "policy", "parking.occupancy", "permanently_hidden")
    full = hidden.filter(pl.col("parking.occupancy") == 1.0)
    assert (hidden.filter(pl.col("parking.occupancy") == 0.0)["permanently_hidden"] == 0.0).all()
    assert (full["permanently_hidden"] > 0.01).all()
    assert (full.group_by("replicate").agg(pl.col("permanently_hidden").n_unique())["permanently_hidden"] == 1).all()
    assert table["parking_seed"].n_unique() == 2
    assert table.group_by("replicate").agg(pl.col("parking_seed").n_unique())["parking_seed"].to_list() == [1, 1]
    assert "permanently_hidden" in {metric.name for metric in metrics_in(table)}
    before = digests(tmp_path / "study")
    run(design, tmp_path / "study", Single())
    assert digests(tmp_path / "study") == before, "a finished study is not flown again"


def test_a_study_is_not_resumed_with_other_parking_places(lined: Path, tmp_path: Path) -> None:
    town = tmp_path / "cross"
    shutil.copytree(lined, town)
    design = small(town, densities=["low"], altitudes_m=[6], policies=["baseline"], replicates=1)
    run(design, tmp_path / "study", Single())
    fewer = damaged("cross", 6)
    save_world(replace(fewer, world=with_places(fewer.world, *load_world(lined).parking[1:])), town, force=True)
    with pytest.raises(PaveTwinError, match="was begun with another world than 'cross' is now"):
        run(design, tmp_path / "study", Single())


def test_a_replicate_shares_its_random_numbers_and_another_has_its_own(reference: Path) -> None:
    table = Store(reference).table()
    shared = table.group_by("replicate").agg(
        pl.col("segment", "traffic_seed", "defect_seed", "sensing_seed", "defects").n_unique()
    )
    assert (shared.drop("replicate") == 1).to_numpy().all()
    for name in ("traffic_seed", "defect_seed", "sensing_seed"):
        assert table[name].n_unique() == 3


def flown_alone(world: Path, row: dict[str, Any], replay: Replay) -> SegmentMetrics:
    """A row's mission over some traffic, flown without a study."""
    town, settings = load_world(world), load_settings("paper", altitude_m=row["altitude_m"])
    target = next(index for index, segment in enumerate(town.segments) if segment.id == row["segment"])
    defects = place([town.segments[target]], row["defect_seed"], DefectOptions(population="paper", per_segment=6))
    environment = prepare(town, settings, defects)
    return fly_over(environment, replay, settings, [target], row["policy"], seed=row["sensing_seed"]).rows[0]


def test_a_mission_of_a_study_is_the_one_that_fly_flies(reference: Path, world: Path) -> None:
    """With the seeds of the table, along a longer recording."""
    cell = {"policy": "hover", "altitude_m": 6.0, "traffic": "medium", "replicate": 1}
    row = Store(reference).table().filter(**cell).row(0, named=True)
    expected = flown_alone(world, row, replay_of(load_world(world), "medium", row["traffic_seed"]))
    for name in ("defects", "swept", "confirmed", "coverage", "time_s", "energy", "wait_s", "surface_coverage"):
        assert row[name] == getattr(expected, name), name


@pytest.mark.slow
def test_a_study_flies_over_recordings_that_were_made_before(world: Path, tmp_path: Path) -> None:
    """Each is a level of traffic, from the drawn take-off on; a mission that outlasts one extends it."""
    town = load_world(world)
    for name, density in (("morning", "v12-p40"), ("night", "low")):
        save_recording(record(town, density, 5, 12.0), tmp_path / f"{name}.parquet")
    files = [str(tmp_path / f"{name}.parquet") for name in ("morning", "night")]
    entry = {"path": str(world), "recordings": files, "take_off_s": [3, 9]}
    design = small(world, worlds=[entry], densities=[], altitudes_m=[10], policies=["hover"], replicates=2)
    ran = run(design, tmp_path / "study", Single())
    assert not ran.failures
    assert ran.table["traffic"].to_list() == ["morning", "night"] * 2
    assert ran.table["traffic_seed"].is_null().all()
    assert ran.table["take_off_s"].n_unique() == 2
    row = ran.table.row(0, named=True)
    assert row["time_s"] > 12
    replay = replay_of(town, "v12-p40", 5)
    replay.start_s = row["take_off_s"]
    expected = flown_alone(world, row, replay)
    assert (row["time_s"], row["coverage"], row["wait_s"]) == (expected.time_s, expected.coverage, expected.wait_s)


def test_a_recording_that_ends_before_the_take_off_refuses_the_study(world: Path, tmp_path: Path) -> None:
    save_recording(record(load_world(world), "low", 5, 12.0), tmp_path / "short.parquet")
    entry = {"path": str(world), "recordings": [str(tmp_path / "short.parquet")], "take_off_s": [0, 12]}
    with pytest.raises(PaveTwinError, match=r"short\.parquet' ends after 12 s, before the latest take-off"):
        run(small(world, worlds=[entry], densities=[]), tmp_path / "study", Single())


class Disturbed(Engine):
    """Another engine, one of whose processes is killed after the first part has come."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.killed = 0

    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        def kill_one(unit: Unit, part: bytes) -> None:
            listener.on_unit(unit, part)
            if not self.killed:
                os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)
                self.killed += 1

        self._engine.fly(plan, units, replace(listener, on_unit=kill_one))


@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(Pool(2), id="pool"),
        pytest.param(Cluster(jobs=2), id="dask", marks=pytest.mark.slow),
        pytest.param(Disturbed(Pool(2)), id="pool, a process killed"),
        pytest.param(Disturbed(Cluster(jobs=2)), id="dask, a worker killed", marks=pytest.mark.slow),
        pytest.param(Disturbed(Cluster(jobs=1)), id="dask, its only worker killed", marks=pytest.mark.slow),
    ],
)
def test_every_engine_writes_the_same_bytes(reference: Path, world: Path, tmp_path: Path, engine: Engine) -> None:
    ran = run(small(world), tmp_path / "study", engine)
    assert not ran.failures
    assert not isinstance(engine, Disturbed) or engine.killed == 1
    assert digests(tmp_path / "study") == digests(reference)


@pytest.mark.slow
def test_a_unit_that_kills_its_process_is_given_up(world: Path, tmp_path: Path) -> None:
    """Killed by a policy of the user's own, which does no harm where the design is read."""
    (tmp_path / "deadly.py").write_text(DEADLY)
    deadly = f"{tmp_path / 'deadly.py'}:Deadly"
    ran = run(small(world, policies=["baseline", deadly], replicates=1), tmp_path / "study", Pool(2))
    assert ran.table.height == 2 * 2 * 2
    assert list(ran.failures) == [DIED]
    assert set(ran.table["policy"]) == {"baseline", "deadly"}


@pytest.mark.parametrize(
    "defects",
    [
        pytest.param({"population": "paper", "per_100_m2": 1}, id="by the design"),
        pytest.param("placed", id="as the world has them", marks=pytest.mark.slow),
    ],
)
def test_a_study_of_defects_by_area_is_read_and_resumed(tmp_path: Path, defects: object) -> None:
    place, folder = tmp_path / "cross", tmp_path / "study"
    save_world(add_defects(built("cross"), DefectOptions(population="paper", per_100_m2=1)), place)
    usual = {"densities": ["low"], "altitudes_m": [10], "defects": defects}
    ran = run(small(place, **usual, replicates=1), folder, Single())
    assert not ran.failures
    assert ran.table["defects"].min() > 0
    assert Store(folder).table().height == 2
    assert run(small(place, **usual, replicates=2), folder, Single()).missions_flown == 2
    write_report(gather("study", {}, Store(folder).table(), {}, seed=1), tmp_path / "report")


def test_more_replicates_are_added_to_a_study(reference: Path, world: Path, tmp_path: Path) -> None:
    run(small(world, replicates=2), tmp_path / "study", Single())
    ran = run(small(world), tmp_path / "study", Single())
    assert ran.missions_flown == 2 * 4
    assert digests(tmp_path / "study") == digests(reference)


def test_a_complete_study_is_left_as_it_is(reference: Path, world: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in (reference / "segments.parquet").iterdir()}
    assert run(small(world), reference, Single()).missions_flown == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"compare": "hoover"}, r"no policy 'hoover' \(did you mean 'hover'\?\); give all or one of baseline, hover"),
        ({"seed": 5}, "its seed is 4, not 5"),
        ({"altitudes_m": [6, 15]}, "its altitudes_m is"),
        ({"sweep": {"tau_o": [0.5]}}, "its sweep is"),
        ({"defects": {"per_100_m2": 2}}, "its defects is placed, not {population: survey, "),
        ({"replicates": 2}, "begun with 3 replicates, more than 2"),
    ],
)
def test_a_folder_of_another_design_is_refused(
    reference: Path, world: Path, values: dict[str, object], words: str
) -> None:
    before = digests(reference)
    with pytest.raises(PaveTwinError, match=words):
        run(small(world, **values), reference, Single())
    assert digests(reference) == before


def test_a_folder_with_anything_else_is_refused(world: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(PaveTwinError, match="holds no study"):
        run(small(world), tmp_path, Single())


def test_a_mission_that_fails_is_a_row_with_its_reason_and_stops_nothing(
    reference: Path, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """A fault of the program leaves its traceback once, though six missions have it."""

    def badly(spec, **how):
        if spec.policy.name == "hover" and spec.settings.altitude_m == 6.0:
            raise ZeroDivisionError("of all things")
        return fly(spec, **how)

    monkeypatch.setattr(fly_unit, "fly", badly)
    ran = run(small(world), tmp_path / "study", Single())
    failed = ran.table.filter(status="failed")
    assert failed.height == 6
    assert failed.select("policy", "altitude_m").unique().rows() == [("hover", 6.0)]
    assert failed["coverage"].is_null().all()
    assert failed["time_s"].is_null().all()
    assert dict(ran.failures) == {"ZeroDivisionError: of all things": 6}
    assert capfd.readouterr().err.count("in badly") == 1
    assert ran.table.filter(status="flown")["time_s"].is_not_null().all()
    monkeypatch.undo()
    assert run(small(world), tmp_path / "study", Single()).missions_flown == 0
    again = run(small(world), tmp_path / "study", Single(), retry=True)
    assert (again.missions_flown, again.failures) == (6, {})
    assert digests(tmp_path / "study") == digests(reference)
