"""One process of SUMO's for simulations that follow each other, as studies have."""

import gc
import os
import signal
import subprocess
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.experiments import engine as local
from pavetwin.traffic import runner
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder
from pavetwin.world.model import World
from scenes.processes import is_over, simulations
from scenes.traffic import bytes_of, scene_world

TRAFFIC = (("medium", 1), ("low", 2), ("medium", 1))


@pytest.fixture(autouse=True)
def _none_runs() -> None:
    """A recorder of an earlier test in this process keeps its simulation until it is garbage collected."""
    gc.collect()


@pytest.fixture
def cross(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path / "cache"))
    return scene_world("cross", tmp_path)


@pytest.fixture
def keeping(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Simulations leave their process to the next one, within a test."""
    monkeypatch.setattr(runner._Kept, "owner", None)
    runner.keep_process()
    yield
    runner._Kept.end()
    assert not simulations(os.getpid())


def recorded(world: World, density: str, seed: int) -> tuple[bytes, list[int]]:
    """The bytes of a recording, and the processes while it was made."""
    with Recorder(Inputs.of(world, density, seed), force=True) as recorder:
        recorder.until(12.0)
        processes = simulations(os.getpid())
    return bytes_of(recorder.until(12.0)), processes


def test_it_repeats_the_bytes_of_processes_of_their_own(cross: World, request: pytest.FixtureRequest) -> None:
    apart = {traffic: recorded(cross, *traffic)[0] for traffic in TRAFFIC}
    assert not simulations(os.getpid())
    request.getfixturevalue("keeping")
    found = [recorded(cross, *traffic) for traffic in TRAFFIC]
    assert [content for content, _ in found] == [apart[traffic] for traffic in TRAFFIC]
    assert len({process for _, processes in found for process in processes}) == 1


def test_a_process_of_a_study_keeps_it(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[int] = []

    def fly_unit(_plan: Any, seed: Any, _on_tick: Any) -> bytes:
        content, processes = recorded(cross, "low", seed)
        used.extend(processes)
        return content

    monkeypatch.setattr(local, "fly_unit", fly_unit)
    monkeypatch.setattr(runner._Kept, "owner", None)
    nothing: Any = None
    batch: Any = [1, 2]
    first, second = local._start(nothing, lambda: None)(batch)
    runner._Kept.end()
    assert first != second
    assert len(used) == 2
    assert len({*used}) == 1


@pytest.mark.usefixtures("keeping")
def test_one_that_died_while_it_waited_is_replaced(cross: World) -> None:
    content, (process,) = recorded(cross, "low", 1)
    os.kill(process, signal.SIGKILL)
    waiting = runner._Kept.waiting
    assert waiting is not None
    assert waiting[1].wait(60) == -signal.SIGKILL
    assert recorded(cross, "low", 1)[0] == content


@pytest.mark.usefixtures("keeping")
@pytest.mark.parametrize("stays_s", [0.3, 600.0])
def test_one_that_crashes_or_hangs_while_it_closes_its_simulation_is_replaced(
    cross: World, monkeypatch: pytest.MonkeyPatch, stays_s: float
) -> None:
    """`sleep` stands for it: it is alive when it is asked for, and never reports that its simulation is closed."""
    monkeypatch.setattr(runner, "GRACE_S", 0.6)
    owner, its_end = Pipe()
    with its_end:
        closing = subprocess.Popen(["sleep", str(stays_s)], stdin=its_end.fileno())
    assert runner._Kept.leave(owner, closing)
    recorded(cross, "low", 1)
    assert closing.returncode is not None
    assert runner._Kept.waiting is not None


@pytest.mark.usefixtures("keeping")
def test_output_of_sumo_from_a_later_simulation_is_reported(cross: World, tmp_path: Path) -> None:
    recorded(cross, "low", 1)
    routes = tmp_path / "mine.rou.xml"
    routes.write_text('<routes><vehicle id="a" depart="0"><route edges="nowhere"/></vehicle></routes>')
    with (
        pytest.raises(PaveTwinError, match=r"cannot drive the routes 'mine.rou.xml' on this world: .*nowhere"),
        Recorder(Inputs.of(cross, None, 1, [routes])) as recorder,
    ):
        recorder.until(5.0)
    assert is_over(lambda: not simulations(os.getpid())), "one that failed is not kept"


@pytest.mark.usefixtures("keeping")
def test_one_that_was_interrupted_is_not_kept(cross: World) -> None:
    simulation = Recorder(Inputs.of(cross, "low", 1))
    simulation.until(5.0)
    assert simulation._simulation is not None
    simulation._simulation.begin(400)
    simulation._end()
    assert not simulations(os.getpid())
