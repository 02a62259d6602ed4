"""Demand for a level of service, found by closed loop on a signalled cross; and held over the recording."""

import json
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from functools import partialmethod
from math import log
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.demand import LevelOfService, density_named
from pavetwin.traffic.demand_search import NEAR, DemandSearch, Trial, found, nearest_first, within_reach
from pavetwin.traffic.flow import MOST_REMOVALS_PER_HOUR, flow_of, to_recording
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.job import SimulationJob
from pavetwin.traffic.record import Recorder, record
from pavetwin.traffic.runner import SimulationProcess, workplace
from pavetwin.traffic.sumo_run import EVERY_S, LARGEST, LevelControl
from pavetwin.world.model import World
from scenes.traffic import EMPTY_RATIO, SCALE_PER_LANE_KM, bytes_of, know_demand, on_the_curve, scene_world


@pytest.fixture(scope="module")
def cross(tmp_path_factory: pytest.TempPathFactory) -> World:
    return scene_world("cross", tmp_path_factory.mktemp("worlds"), sidewalks=False)


@pytest.fixture(autouse=True)
def cache(cross: World, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One for the module, in which the cross has a made-up demand."""
    folder = tmp_path_factory.getbasetemp() / "demand-cache"
    monkeypatch.setenv("PAVETWIN_CACHE", str(folder))
    know_demand(cross)
    return folder


@pytest.fixture
def fresh(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:  # noqa: ARG001 - comes after it
    """A cache in which nothing is known yet."""
    folder = tmp_path / "fresh"
    monkeypatch.setenv("PAVETWIN_CACHE", str(folder))
    return folder


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
def test_the_search_converges_and_the_recording_holds_the_level(cross: World) -> None:
    _, target = DemandSearch(cross, "europe").target(LevelOfService.D)
    recording = record(cross, "los-D", 1, 600.0)
    flow = flow_of(recording)
    assert flow.level == "D"
    assert flow.ratio == pytest.approx(target, rel=NEAR)
    assert flow.ratio == pytest.approx(recording.speed_ratio or 0.0)
    assert (flow.removed_per_vehicle_hour or 0.0) <= MOST_REMOVALS_PER_HOUR
    assert not [remark for remark in recording.remarks if "instead of" in remark]
    assert recording.origin.asked is not None
    assert recording.origin.asked.vehicles_per_lane_km is not None
    assert recording.path is not None
    assert recording.path.name == "los-D-1.parquet"


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_whether_the_demand_was_known_or_not(cross: World, fresh: Path) -> None:
    first = bytes_of(record(cross, "los-D", 2, 60.0, force=True))
    (kept,) = fresh.rglob("demand-europe.json")
    kept.unlink()
    assert bytes_of(record(cross, "los-D", 2, 60.0, force=True)) == first
    assert kept.is_file()


def test_another_seed_begins_with_the_demand_that_was_found(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    once = found(Inputs.of(cross, "los-D", 1)).asked
    monkeypatch.setattr(DemandSearch, "_simulated", lambda *_: pytest.fail("a trial was simulated again"))
    other = found(Inputs.of(cross, "los-D", 7))
    assert other.asked == once
    assert other.hash == Inputs.of(cross, "los-D", 7).hash  # a recording is found before its demand is


@pytest.mark.slow
def test_a_longer_recording_begins_with_the_shorter_one(cross: World) -> None:
    with Recorder(Inputs.of(cross, "los-D", 3), force=True) as recorder:
        short = recorder.until(35.0)
        longer = recorder.until(90.0)
    assert longer.until(35.0).same_traffic(short)
    assert bytes_of(longer) == bytes_of(record(cross, "los-D", 3, 90.0, force=True))


def test_a_level_beyond_the_network_is_refused_with_what_it_can_reach(cross: World) -> None:
    with pytest.raises(PaveTwinError, match=r"level of service A .* even nearly empty streets allow \d\d %.*Ask for"):
        record(cross, "los-A", 1, 10.0)


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
def test_an_arterial_without_signals_flows_at_level_a(tmp_path: Path) -> None:
    arterial = scene_world("arterial", tmp_path, sidewalks=False)
    empty, target = DemandSearch(arterial, "europe").target(LevelOfService.A)
    assert empty.ratio > 0.9
    flow = flow_of(record(arterial, "los-A", 1, 300.0))
    assert flow.level == "A"
    assert flow.ratio == pytest.approx(target, rel=NEAR)
    assert flow.removed_per_vehicle_hour == 0.0


def test_quiet_hours_have_fewer_vehicles_than_busy_ones(cross: World) -> None:
    search = DemandSearch(cross, "europe")
    night, morning, busiest = (search.density(density_named(f"hour-{hour:02}")) for hour in (3, 12, 17))
    level_d, _ = search.of_level(LevelOfService.D)
    of = [each.vehicles_per_lane_km or 0.0 for each in (night, morning, busiest)]
    assert of[0] < 0.1 * of[1] < of[1] < of[2] == pytest.approx(level_d, abs=1e-3)


def test_the_kept_trials_are_of_these_inputs_alone(cross: World, cache: Path) -> None:
    search = DemandSearch(cross, "europe")
    search.target(LevelOfService.D)
    (kept,) = cache.rglob("demand-europe.json")
    stored = json.loads(kept.read_text())
    kept.write_text(json.dumps({**stored, "inputs": "of another version"}))
    assert DemandSearch(cross, "europe")._known == {}
    kept.write_text(json.dumps(stored))
    assert DemandSearch(cross, "europe")._known == search._known


class _Simulations:
    """Stands in for SUMO's processes: notes what is asked of them, in order."""

    def __init__(self, fails: bool = False) -> None:
        self.fails = fails
        self.reported: list[str] = []
        self.pedestrians: list[bool] = []

    def __call__(self, job: SimulationJob) -> "_Simulations":
        self.pedestrians.append(job.reads_pedestrians)
        return self

    def begin(self, _frames: int) -> None:
        self.reported.append("begin")

    def finish(self, _on_progress: object) -> None:
        self.reported.append("finish")
        if self.fails:
            raise PaveTwinError("SUMO crashed.")

    def close(self) -> None:
        self.reported.append("close")


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize(("level", "side_by_side"), [("C", 2), ("F", 2), ("A", 1)])
def test_the_first_two_trials_run_side_by_side_where_the_second_can_be_guessed(
    cross: World, monkeypatch: pytest.MonkeyPatch, level: str, side_by_side: int
) -> None:
    simulations = _Simulations()
    monkeypatch.setattr("pavetwin.traffic.demand_search.SimulationProcess", simulations)
    monkeypatch.setattr(DemandSearch, "_measured", lambda *_: Trial(1.0, 0.72, 0.0, 0.0))
    with suppress(PaveTwinError):
        DemandSearch(cross, "europe").target(LevelOfService(level))
    assert simulations.reported == ["begin"] * side_by_side + ["finish"] * side_by_side + ["close"] * side_by_side
    assert simulations.pedestrians == [False] * side_by_side


@pytest.mark.usefixtures("fresh")
def test_both_simulations_end_where_one_fails(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    simulations = _Simulations(fails=True)
    monkeypatch.setattr("pavetwin.traffic.demand_search.SimulationProcess", simulations)
    search = DemandSearch(cross, "europe")
    with pytest.raises(PaveTwinError, match="crashed"):
        search.target(LevelOfService.C)
    assert simulations.reported == ["begin", "begin", "finish", "close", "close"]
    assert search.trials == []


@pytest.mark.usefixtures("fresh")
def test_progress_of_search_and_recording_is_reported_separately(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DemandSearch, "_simulated", on_the_curve)
    searched: list[float] = []
    recorded: list[float] = []
    record(cross, "los-D", 5, 10.0, on_progress=recorded.append, on_search=searched.append)
    assert searched[0] == 1.0
    assert recorded[0] < 1.0 == recorded[-1]
    assert recorded == sorted(recorded)


@pytest.mark.usefixtures("fresh")
def test_a_search_along_the_curve_finds_the_density_of_the_target(
    cross: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DemandSearch, "_simulated", on_the_curve)
    for level in list(LevelOfService)[1:]:
        found_density, trials = DemandSearch(cross, "europe").of_level(level)
        target = level.target(trials[0].ratio)
        wanted = SCALE_PER_LANE_KM * (2 * log(EMPTY_RATIO / target)) ** 0.5
        assert found_density == pytest.approx(wanted, rel=0.06)  # trials have whole vehicles


def test_pedestrians_that_are_not_read_change_no_vehicle(tmp_path: Path) -> None:
    inputs = Inputs.of(scene_world("cross", tmp_path), "medium", 1)
    parts = []
    for reads in (True, False):
        with workplace() as folder:
            job = replace(inputs.job(folder), reads_pedestrians=reads, warm_up_s=(20.0, 20.0))
            with closing(SimulationProcess(job)) as simulation:
                parts.append(simulation.record(40))
    both, vehicles = (to_recording(part, inputs.origin(part), inputs.speed_limits) for part in parts)
    driving = ~both.agents.is_pedestrian[both.agent]
    assert 0 < driving.sum() < len(driving)
    assert not vehicles.agents.is_pedestrian.any()
    assert (both.x[driving] == vehicles.x).all()
    assert (both.speed_mps[driving] == vehicles.speed_mps).all()


class _Jam:
    """A simulation whose vehicles all drive at one speed."""

    def __init__(self, speed_mps: float) -> None:
        self.vehicle = self
        self.speed_mps = speed_mps

    def getIDList(self) -> list[str]:  # noqa: N802 - SUMO's names
        return ["a", "b"]

    def getPosition(self, _: str) -> tuple[float, float]:  # noqa: N802
        return 100.0, 0.0

    def getAngle(self, _: str) -> float:  # noqa: N802
        return 90.0

    def getSpeed(self, _: str) -> float:  # noqa: N802
        return self.speed_mps


@pytest.mark.parametrize(("speed_mps", "sign"), [(2.0, -1), (6.945, 0), (12.0, 1)])
def test_slow_traffic_gets_fewer_vehicles_and_fast_traffic_more(cross: World, speed_mps: float, sign: int) -> None:
    inputs = Inputs.of(cross, "los-D", 1)
    control = LevelControl(_Jam(speed_mps), inputs.speed_limits, 0.5, 100)
    counts = [control.vehicles() for _ in range(0, 1200, EVERY_S)]
    assert [counts[-1] < 99, counts[-1] == 100, counts[-1] > 101][sign + 1]
    assert 100 * 2.7182**-LARGEST - 1 <= counts[-1] <= 100 * 2.7183**LARGEST + 1


@pytest.fixture
def keeps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Makes the nearly empty network keep a share of the speed limits."""
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))

    def keep(share: float) -> None:
        monkeypatch.setattr(DemandSearch, "_simulated", partialmethod(on_the_curve, empty_ratio=share))

    return keep


@pytest.mark.parametrize(
    ("empty", "asked", "flown"),
    [
        (0.72, "los-C", "los-C"),
        (0.47, "los-C", "los-D"),
        (0.36, "los-C", "los-E"),
        (0.36, "los-C+south_asia", "los-E+south_asia"),
        (0.72, "los-A", "los-B"),
        (0.36, "hour-08", "hour-08"),
        (0.36, "high", "high"),
    ],
)
def test_the_nearest_level_that_is_reached_takes_its_place(
    cross: World, keeps: Callable[[float], None], empty: float, asked: str, flown: str
) -> None:
    keeps(empty)
    assert within_reach(cross, density_named(asked)).name == flown


def test_of_two_levels_as_near_the_worse_comes_first() -> None:
    assert "".join(nearest_first(LevelOfService.C)) == "CDBEAF"
    assert "".join(nearest_first(LevelOfService.A)) == "ABCDEF"


def test_what_goes_wrong_in_the_simulation_is_no_level_out_of_reach(
    cross: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise PaveTwinError("SUMO crashed.")

    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path))
    monkeypatch.setattr(DemandSearch, "_simulated", fail)
    with pytest.raises(PaveTwinError, match="SUMO crashed"):
        within_reach(cross, density_named("los-C"))
