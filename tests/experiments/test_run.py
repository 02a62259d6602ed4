"""Studies: the same table whoever flies it, however often it is killed; and what fails is written down."""

import multiprocessing
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from distributed import LocalCluster
from polars.testing import assert_frame_equal

from pavetwin.config import load_settings
from pavetwin.defects import DefectOptions, add_defects, place
from pavetwin.errors import PaveTwinError
from pavetwin.experiments import fly_unit
from pavetwin.experiments.design import Design, read_design
from pavetwin.experiments.engines import Engine, Listener, Pool, Single
from pavetwin.experiments.engines.base import DIED, in_batches
from pavetwin.experiments.engines.cluster import Cluster
from pavetwin.experiments.metrics import metrics_in
from pavetwin.experiments.plan import Plan, Unit, units_of
from pavetwin.experiments.report import gather, write_report
from pavetwin.experiments.run import run
from pavetwin.experiments.store import Store, query
from pavetwin.mission.environment import prepare
from pavetwin.mission.fly import fly, fly_over
from pavetwin.mission.metrics import SegmentMetrics
from pavetwin.mission.replay import Replay, grown_s, replay_of
from pavetwin.navigation.patterns import PATTERNS
from pavetwin.policies import POLICIES
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder, record
from pavetwin.traffic.recording_file import load_recording, save_recording
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world, save_world
from scenes import built, damaged
from scenes.folders import digests
from scenes.parking import save_cross_with_rows, with_places

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


MINE = """
from pavetwin.policies import GoOn, Policy

class Mine(Policy):
    name = "mine"  # {}

    def decide(self, snapshot):
        return GoOn()
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "cross"
    save_world(damaged("cross", 6), folder)
    return folder


def small(world: Path, **values: object) -> Design:
    usual = {
        "worlds": [str(world)],
        "densities": ["low", "medium"],
        "altitudes_m": [6, 10],
        "policies": ["baseline", "hover"],
        "presets": ["paper"],
        "replicates": 3,
        "seed": 4,
    }
    return Design.parse(usual | values, where="the design")


@pytest.fixture(scope="module")
def reference(world: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that nothing disturbed, flown by one process."""
    folder = tmp_path_factory.mktemp("reference") / "study"
    run(small(world), folder, Single())
    return folder


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
def test_the_same_bytes_whoever_flies(reference: Path, world: Path, tmp_path: Path, engine: Engine) -> None:
    ran = run(small(world), tmp_path / "study", engine)
    assert not ran.failures
    assert not isinstance(engine, Disturbed) or engine.killed == 1
    assert digests(tmp_path / "study") == digests(reference)


@pytest.mark.slow
def test_a_unit_that_kills_whoever_flies_it_is_given_up(world: Path, tmp_path: Path) -> None:
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


# --- Failures -------------------------------------------------------------------------------------------------------


def test_a_mission_that_fails_is_a_row_with_its_reason_and_stops_nothing(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
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
    assert not run(small(world), tmp_path / "study", Single(), retry=True).failures


def test_failed_missions_are_flown_again_and_no_others(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def badly(spec, **how):
        if spec.policy.name == "hover" and spec.settings.altitude_m == 6.0:
            raise ZeroDivisionError("of all things")
        return fly(spec, **how)

    monkeypatch.setattr(fly_unit, "fly", badly)
    design, folder = small(world, densities=["low"]), tmp_path / "study"
    assert sum(run(design, folder, Single()).failures.values()) == 3
    monkeypatch.undo()
    again = run(design, folder, Single(), retry=True)
    assert (again.missions_flown, again.failures) == (3, {})
    run(design, tmp_path / "never failed", Single())
    assert digests(folder) == digests(tmp_path / "never failed")


# --- The user's own files change ------------------------------------------------------------------------------------


@pytest.fixture
def flights(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The policy of each mission as it is flown, the path of its file left out."""
    found: list[str] = []

    def noted(spec, **how):
        found.append(spec.policy.name.rpartition(":")[2])
        return fly(spec, **how)

    monkeypatch.setattr(fly_unit, "fly", noted)
    return found


@pytest.mark.slow
def test_only_the_missions_of_an_edited_policy_are_flown_again(world: Path, tmp_path: Path, flights: list[str]) -> None:
    file, folder, notices = tmp_path / "mine.py", tmp_path / "study", []
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=2)
    run(design, folder, Single(), on_notice=notices.append)
    before = Store(folder).table()
    file.write_text(MINE.format("second"))
    flights.clear()
    assert notices == []
    ran = run(design, folder, Single(), on_notice=notices.append)
    assert (ran.missions_flown, set(flights)) == (8, {"Mine"})
    assert notices == [
        f"mine.py changed since: 8 of 16 missions are flown again; their former rows are kept in {folder / 'former'}."
    ]
    run(design, tmp_path / "from the second on", Single())
    former = [path for path in digests(folder) if path.startswith("former/")]
    assert {path: it for path, it in digests(folder).items() if path not in former} == digests(
        tmp_path / "from the second on"
    )
    old = before.filter(policy="mine")
    assert {Path(path).parts[1] for path in former} == set(old["files_hash"])
    assert_frame_equal(Store(folder).former(), old, check_row_order=False)
    assert set(old["files_hash"]).isdisjoint(ran.table.filter(policy="mine")["files_hash"])
    assert ran.table.filter(policy="baseline")["files_hash"].is_null().all()
    count = "select count(*) n from former where policy = 'mine'"
    assert query(folder, count)["n"].to_list() == [8]
    assert run(design, folder, Single()).missions_flown == 0


def test_a_study_that_is_stopped_after_an_edit_holds_no_mission_of_before(
    world: Path, tmp_path: Path, flights: list[str]
) -> None:
    file, folder = tmp_path / "mine.py", tmp_path / "study"
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], densities=["low"])
    run(design, folder, Single())
    file.write_text(MINE.format("second"))

    class Stopped(Single):
        def fly(self, plan, units, listener):
            super().fly(plan, units[:1], listener)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(design, folder, Stopped())
    left = Store(folder).table()
    assert (left.filter(policy="baseline").height, left.filter(policy="mine").height) == (6, 2)
    assert left.filter(policy="mine")["files_hash"].n_unique() == 1
    assert Store(folder).former().height == 6
    flights.clear()
    run(design, folder, Single())
    assert flights == ["Mine"] * 4
    run(design, tmp_path / "never stopped", Single())
    assert_frame_equal(Store(folder).table(), Store(tmp_path / "never stopped").table())


def test_what_a_policy_imports_is_part_of_it(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flights: list[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    file, helper = tmp_path / "mine.py", tmp_path / "helper_of_mine.py"
    file.write_text("import helper_of_mine\n" + MINE)
    helper.write_text("LIMIT = 1")
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=1, densities=["low"])
    run(design, tmp_path / "study", Single())
    assert set(Store(tmp_path / "study").description()["files"]) == {str(file), str(helper)}
    assert run(design, tmp_path / "study", Single()).missions_flown == 0
    helper.write_text("LIMIT = 2")
    flights.clear()
    run(design, tmp_path / "study", Single())
    assert flights == ["Mine"] * 2


@pytest.mark.parametrize(
    ("more", "again"),
    [
        pytest.param("", ["careful"], id="a policy alone"),
        pytest.param(
            "from pavetwin.navigation.patterns import PATTERNS\nPATTERNS.add('odd', PATTERNS.get('boustrophedon'))",
            ["baseline", "careful"],
            id="a pattern too",
        ),
    ],
)
def test_an_edited_plugin_concerns_what_it_registers(
    world: Path, tmp_path: Path, flights: list[str], more: str, again: list[str]
) -> None:
    file, folder = tmp_path / "plugin.py", tmp_path / "study"
    own = MINE.replace("class Mine", "@policy('careful')\nclass Careful").replace("Policy\n", "Policy, policy\n", 1)
    file.write_text(f"{own.replace('mine', 'careful')}\n{more}")
    design = small(
        world, policies=["baseline", "careful"], plugins=[str(file)], replicates=1, densities=["low"], altitudes_m=[10]
    )
    try:
        run(design, folder, Single())
        file.write_text(file.read_text() + "\n# thought over")
        flights.clear()
        run(design, folder, Single())
        assert flights == again
    finally:
        POLICIES.restore("careful", None)
        if more:
            PATTERNS.restore("odd", None)


def test_a_file_that_is_edited_while_a_study_flies_fails_its_missions(world: Path, tmp_path: Path) -> None:
    """They would stand in the table under another file than they were flown with."""
    file, folder = tmp_path / "mine.py", tmp_path / "study"
    file.write_text(MINE.format("first"))
    design = small(world, policies=["baseline", f"{file}:Mine"], replicates=2, densities=["low"], altitudes_m=[10])

    class Edited(Single):
        def fly(self, plan, units, listener):
            super().fly(plan, units[:1], listener)
            file.write_text(MINE.format("second"))
            super().fly(plan, units[1:], replace(listener, on_ready=lambda: None))

    ran = run(design, folder, Edited())
    assert list(ran.failures) == [f"the design: '{file}' is not what the study began with."]
    assert run(design, folder, Single(), retry=True).missions_flown == 3
    assert not run(design, folder, Single()).failures


def test_missions_over_changed_routes_are_flown_again(world: Path, tmp_path: Path) -> None:
    edge = next(lane.edge for lane in load_world(world).lanes if lane.kind == "driving")
    route, folder = tmp_path / "own.rou.xml", tmp_path / "study"

    def departing(*times_s: int) -> str:
        trips = (f'<trip id="t{time_s}" depart="{time_s}" from="{edge}" to="{edge}"/>' for time_s in times_s)
        return f"<routes>{''.join(trips)}</routes>"

    entry = {"path": str(world), "routes": [str(route)], "take_off_s": [500, 500]}
    design = small(world, worlds=[entry], densities=[], replicates=1, altitudes_m=[10])
    route.write_text(departing(0))
    assert sum(run(design, folder, Single()).failures.values()) == 2
    route.write_text(departing(0, *range(400, 900, 20)))
    ran = run(design, folder, Single())
    assert (ran.missions_flown, ran.failures) == (2, {})
    assert (Store(folder).former()["status"] == "failed").all()


def test_progress_says_what_is_done_before_the_first_mission(world: Path, tmp_path: Path) -> None:
    told: list[str] = []
    run(small(world, replicates=1), tmp_path / "study", Pool(2), on_progress=lambda _share, what: told.append(what))
    assert [what for what in told if "lying missions" not in what] == [
        "Planning: where to fly over cross at 6 m",
        "Planning: where to fly over cross at 10 m",
        "Starting 2 processes",
    ]
    assert told[3:5] == [f"Recording traffic {recorded}/2, flying missions 0/8" for recorded in (0, 1)]
    assert told[-1] == "Flying missions 8/8"


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


# --- Killed ---------------------------------------------------------------------------------------------------------


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
    return next(cached(load_world(world), "traffic"))


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / "segments.parquet").glob("w*.parquet"))


# --- The store and the rest -----------------------------------------------------------------------------------------


def test_sql_over_the_table(reference: Path) -> None:
    answer = query(reference, "select policy, count(*) n, avg(time_s) t from segments group by policy order by policy")
    table = Store(reference).table()
    assert answer["n"].to_list() == [12, 12]
    assert answer["t"].to_list() == pytest.approx(
        [table.filter(policy=name)["time_s"].mean() for name in ("baseline", "hover")]
    )


@pytest.mark.parametrize(
    ("sql", "words"),
    [
        ("select foo from segments", "The query failed.*foo"),
        ("drop view segments", "not a query"),
        ("???", "query"),
        ("copy segments to 'x.csv'", "not a query"),
        ("from read_csv('/etc/passwd')", "The query failed"),
    ],
)
def test_a_question_that_is_none_is_said_in_a_line(reference: Path, sql: str, words: str) -> None:
    with pytest.raises(PaveTwinError, match=words):
        query(reference, sql)


def test_a_folder_without_a_study_is_said(tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match="holds no study"):
        query(tmp_path, "from segments")


def test_a_damaged_part_is_flown_again(world: Path, tmp_path: Path) -> None:
    design = small(world, replicates=1, densities=["low"])
    run(design, tmp_path / "study", Single())
    (part,) = (tmp_path / "study" / "segments.parquet").iterdir()
    whole = part.read_bytes()
    for broken in (whole[: len(whole) // 2], whole[:40] + bytes(2000) + whole[2040:]):
        part.write_bytes(broken)
        with pytest.raises(PaveTwinError, match="is damaged; run the study again"):
            Store(tmp_path / "study").table()
        assert run(design, tmp_path / "study", Single()).missions_flown == 4
        assert part.read_bytes() == whole


def test_a_part_in_another_s_place_is_not_counted_twice(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "study")
    parts = Store(tmp_path / "study").parts()
    shutil.copyfile(parts[0], parts[2])
    with pytest.raises(PaveTwinError, match="holds another part of a study"):
        Store(tmp_path / "study").table()


def test_a_damaged_design_is_said(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "study")
    (tmp_path / "study" / "design.yaml").write_text("design: 3")
    with pytest.raises(PaveTwinError, match=r"design\.yaml"):
        Store(tmp_path / "study").table()


def test_taking_off_after_one_s_own_demand_has_ended_is_a_failure(world: Path, tmp_path: Path) -> None:
    edges = [lane.edge for lane in load_world(world).lanes if lane.kind == "driving"]
    route = tmp_path / "short.rou.xml"
    route.write_text(f'<routes><trip id="a" depart="0" from="{edges[0]}" to="{edges[0]}"/></routes>')
    entry = {"path": str(world), "routes": [str(route)], "take_off_s": [500, 600]}
    ran = run(small(world, worlds=[entry], densities=[], replicates=1), tmp_path / "study", Single())
    assert len(ran.failures) == 1
    assert "its demand has ended; change take_off_s" in next(iter(ran.failures))


def test_no_scheduler_is_said_in_a_line(world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.experiments.engines.cluster.ANSWER_S", 1.0)
    with pytest.raises(PaveTwinError, match=r"`scheduler` tcp://127.0.0.1:9: no Dask scheduler answers there"):
        run(small(world), tmp_path / "study", Cluster(scheduler="tcp://127.0.0.1:9"))
    assert list(tmp_path.iterdir()) == [], "another design may be flown there"


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" * 9], ids=["nothing", "of the web"])
def test_what_answers_and_is_no_scheduler_is_said_in_a_line(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes
) -> None:
    monkeypatch.setattr("pavetwin.experiments.engines.cluster.ANSWER_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"

        def serve() -> None:
            caller, _ = server.accept()
            caller.sendall(answer)
            with caller:
                while caller.recv(4096):
                    pass

        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(PaveTwinError, match=f"`scheduler` {address}: no Dask scheduler answers there"):
            run(small(world), tmp_path / "study", Cluster(scheduler=address))
    assert list(tmp_path.iterdir()) == []


def test_a_scheduler_without_workers_is_said_at_once(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    with LocalCluster(n_workers=0, processes=False, protocol="tcp://", dashboard_address=None) as cluster:
        monkeypatch.setattr("pavetwin.experiments.engines.cluster.ANSWER_S", 1.0)
        engine = Cluster(scheduler=cluster.scheduler_address)
        with pytest.raises(PaveTwinError, match="has no workers"):
            run(small(world), tmp_path / "study", engine, on_progress=lambda _share, what: told.append(what))
    assert told[-1] == f"Waiting for workers of the Dask scheduler {cluster.scheduler_address}"


def test_a_replicate_stays_with_one_process_while_there_are_enough_of_them() -> None:
    design = Design.parse({"worlds": ["a"], "replicates": 6}, where="the design")
    units = units_of(design)
    assert [len(batch) for batch in in_batches(units, 3)] == [3] * 6
    assert [len(batch) for batch in in_batches(units, 4)] == [1] * 18
    assert [unit for batch in in_batches(units, 3) for unit in batch] == list(units)


def test_a_study_of_an_earlier_format_can_be_read_and_is_not_continued(reference: Path, tmp_path: Path) -> None:
    shutil.copytree(reference, tmp_path / "old")
    description = tmp_path / "old" / "design.yaml"
    description.write_text(description.read_text().replace("format: 2", "format: 1"))
    old = Store(tmp_path / "old")
    assert old.table().equals(Store(reference).table())
    with pytest.raises(PaveTwinError, match="begun with format 1, not 2; choose another folder"):
        old.check_design(old.design())
