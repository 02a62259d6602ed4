"""The process that simulations are forked off: one for each owner, replaced when killed, gone with its owner."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic import forks
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder, record
from pavetwin.world.model import World
from scenes.processes import is_gone, is_over, parent, simulations, templates
from scenes.traffic import SOURCES, bytes_of, scene_world

BEGINNING = (
    "import os, sys, time; sys.path.insert(0, sys.argv[2])\n"
    "from pathlib import Path\n"
    "from scenes.processes import simulations, templates\n"
    "from scenes.traffic import world_on\n"
    "from pavetwin.traffic.inputs import Inputs\n"
    "from pavetwin.traffic.record import Recorder\n"
    "def recorder(seed):\n"
    "    return Recorder(Inputs.of(world_on(Path(sys.argv[1])), 'low', seed))\n"
)
"""Of the scripts that are owners."""


@pytest.fixture
def cross(tmp_path: Path) -> World:
    return scene_world("cross", tmp_path)


@contextmanager
def owner(world: World, script: str) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen(
        [sys.executable, "-c", BEGINNING + script, str(world.network_file), str(Path(__file__).parents[1])],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SOURCES)},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def test_simulations_at_the_same_time_share_a_template_and_nothing_else(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as first, Recorder(Inputs.of(cross, "low", 2)) as second:
        first.until(5.0)
        second.until(5.0)
        (template,) = templates(os.getpid())
        processes = simulations(os.getpid())
        assert len(processes) == 2
        assert {os.getsid(process) for process in (template, *processes)} == {template, *processes}
        for process in processes:
            held = [str(handle.readlink()) for handle in Path(f"/proc/{process}/fd").iterdir()]
            assert sum(handle.startswith("socket:") for handle in held) == 1  # the connection with its own owner
        longer = first.until(10.0), second.until(10.0)
    assert not simulations(os.getpid())
    assert templates(os.getpid()) == [template]
    for seed, recording in enumerate(longer, start=1):
        assert recording.same_traffic(record(cross, "low", seed, 10.0, force=True))


def test_a_crash_is_told_by_its_signal_and_the_template_goes_on(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as crashing, Recorder(Inputs.of(cross, "low", 2)) as other:
        other.until(5.0)
        before, template = simulations(os.getpid()), templates(os.getpid())
        crashing.until(5.0)
        (process,) = set(simulations(os.getpid())) - set(before)
        os.kill(process, signal.SIGSEGV)
        with pytest.raises(PaveTwinError, match=r"signal 11.*without a word"):
            crashing.until(10.0)
        assert simulations(os.getpid()) == before
        other.until(10.0)
        crashing.until(10.0)
        assert templates(os.getpid()) == template


def test_a_killed_template_costs_no_simulation_and_is_replaced(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as recorder:
        recorder.until(5.0)
        (killed,), (process,) = templates(os.getpid()), simulations(os.getpid())
        os.kill(killed, signal.SIGKILL)
        assert is_over(lambda: is_gone(killed))
        longer = recorder.until(10.0)  # by the simulation that was alive
        assert not is_gone(process)
        record(cross, "low", 2, 5.0)
        assert killed not in templates(os.getpid())
    assert is_over(lambda: is_gone(process))
    assert len(templates(os.getpid())) == 1
    assert bytes_of(longer) == bytes_of(record(cross, "low", 1, 10.0, force=True))


def test_a_simulation_that_is_lost_with_its_template_is_one_plain_error(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as recorder:
        recorder.until(5.0)
        for process in (*templates(os.getpid()), *simulations(os.getpid())):
            os.kill(process, signal.SIGKILL)
        with pytest.raises(PaveTwinError, match="was lost while recording"):
            recorder.until(10.0)


def test_threads_share_a_template(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forks, "_template", None)
    before = set(templates(os.getpid()))
    with ThreadPoolExecutor(3) as threads:
        for recording in threads.map(lambda seed: record(cross, "low", seed, 5.0), range(3)):
            assert recording.duration_s == 5.0
    (made,) = set(templates(os.getpid())) - before
    assert forks._template is not None
    assert forks._template.end() == 0
    assert is_gone(made)


def test_no_process_at_all_is_one_plain_error(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forks, "_template", None)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(PaveTwinError, match="No process for SUMO") as caught:
        record(cross, "low", 1, 5.0)
    assert "\n" not in str(caught.value)


def test_a_forked_owner_has_a_template_of_its_own(cross: World) -> None:
    script = (
        "with recorder(1) as mine:\n"
        "    mine.until(5.0)\n"
        "    print(*templates(os.getpid()), flush=True)\n"
        "    fork = os.fork()\n"
        "    if fork == 0:\n"
        "        recorder(2).until(5.0)\n"
        "        print(*templates(os.getpid()), flush=True)\n"
        "        time.sleep(60)\n"
        "    time.sleep(60)\n"
    )
    with owner(cross, script) as process:
        assert process.stdout is not None
        (parents,) = map(int, process.stdout.readline().split())
        (forks_own,) = map(int, process.stdout.readline().split())
        assert forks_own != parents
        fork = parent(forks_own)
        assert fork is not None
        process.kill()
        process.wait()
        # The fork holds its parent's simulation, as any fork holds open files, but not the template.
        assert not is_gone(fork)
        os.kill(fork, signal.SIGKILL)
        assert is_over(lambda: is_gone(parents) and is_gone(forks_own))


def test_nothing_is_left_of_an_owner_that_ends(cross: World) -> None:
    script = "recorder(1).until(5.0)\nprint(*templates(os.getpid()), flush=True)\n"
    with owner(cross, script) as process:
        assert process.stdout is not None
        (template,) = map(int, process.stdout.readline().split())
        assert process.wait(20) == 0
        assert is_gone(template)
