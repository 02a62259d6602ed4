"""Recording on demand: parts that make one recording, SUMO's process from its first frame to its end, and its death."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.flow import to_recording
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder, record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import save_recording
from pavetwin.traffic.runner import SimulationProcess
from pavetwin.traffic.tracks import PackedPart, TrackPart
from pavetwin.world.model import World
from scenes.processes import is_gone, is_over, simulations
from scenes.traffic import ROUTES, SOURCES, bytes_of, scene_world

ENDS_S = (0.5, 7.0, 7.5, 30.0, 90.0)
"""Ends of the parts that are compared with one recording up to the last end."""


@pytest.fixture
def cross(tmp_path: Path) -> World:
    return scene_world("cross", tmp_path)


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of the simulations' folders. The cache holds no recording of other tests."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


@pytest.mark.parametrize("traffic", ["low", "high", "own routes"])
def test_parts_make_the_same_recording_as_one(cross: World, tmp_path: Path, traffic: str) -> None:
    routes = [tmp_path / "mine.rou.xml"] if traffic == "own routes" else []
    for path in routes:
        path.write_text(ROUTES)
    density = None if routes else traffic
    whole = record(cross, density, 2, ENDS_S[-1], routes=routes)
    expected = bytes_of(whole)
    with Recorder(Inputs.of(cross, density, 2, routes), force=True) as recorder:
        for end_s in ENDS_S:
            part = recorder.until(end_s)
            assert part.same_traffic(whole.until(end_s))
            assert part.removals == whole.until(end_s).removals
            assert part.agents.kind == whole.until(end_s).agents.kind
        assert len(simulations(os.getpid())) == 1
    assert bytes_of(part) == expected
    assert not simulations(os.getpid())


def test_what_is_recorded_is_packed_piece_by_piece(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording of hours would not fit into memory as poses, nor as what SUMO's process hands over at once."""
    monkeypatch.setattr("pavetwin.traffic.tracks.PART_STEPS", 30)
    whole = record(cross, "medium", 3, 60.0)
    monkeypatch.setattr("pavetwin.traffic.record.FRAMES_AT_ONCE", 50)
    reported: list[float] = []
    handed: list[int] = []
    begin = SimulationProcess.begin
    order: list[str] = []

    def counted(self: SimulationProcess, frames: int) -> None:
        handed.append(frames)
        order.append("simulate")
        begin(self, frames)

    def packed(*given: Any) -> Recording:
        order.append("pack")
        return to_recording(*given)

    monkeypatch.setattr(SimulationProcess, "begin", counted)
    monkeypatch.setattr("pavetwin.traffic.record.to_recording", packed)
    with Recorder(Inputs.of(cross, "medium", 3), force=True) as recorder:
        pieces = recorder.until(60.0, reported.append)
        assert sum(handed) == pieces.frames
        assert max(handed) == 50
        assert order == ["simulate", "simulate", "pack", "simulate", "pack", "pack"]  # SUMO goes on meanwhile
        *done, last = pieces.tracks.parts
        assert len(done) > 2
        assert all(isinstance(part, PackedPart) for part in done)
        assert isinstance(last, TrackPart)
    assert bytes_of(pieces) == bytes_of(whole)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0


def test_a_recording_from_the_disk_is_extended_by_one_simulation(cross: World) -> None:
    short = record(cross, "medium", 1, 10.0)
    begun: list[float] = []
    with Recorder(Inputs.of(cross, "medium", 1)) as recorder:
        assert recorder.until(5.0).same_traffic(short.until(5.0))
        assert not simulations(os.getpid())  # nothing is simulated that is there
        recorder.until(20.0)
        (process,) = simulations(os.getpid())
        longest = recorder.until(60.0, begun.append)
        assert simulations(os.getpid()) == [process]
        assert begun[-1] == 1.0
    assert bytes_of(longest) == bytes_of(record(cross, "medium", 1, 60.0, force=True))


def test_traffic_that_sumo_does_not_repeat_is_refused(cross: World) -> None:
    other, wanted = record(cross, "medium", 1, 10.0), Inputs.of(cross, "medium", 2)
    save_recording(replace(other, origin=replace(other.origin, inputs=wanted.hash)), wanted.path)
    before = wanted.path.read_bytes()
    with pytest.raises(PaveTwinError, match="did not repeat"):
        record(cross, "medium", 2, 20.0)
    assert wanted.path.read_bytes() == before


def test_sumo_ends_with_its_recorder(cross: World, places: Path) -> None:
    recorder = Recorder(Inputs.of(cross, "low", 1))
    recorded = recorder.until(5.0)
    assert bytes_of(recorded)  # written at once
    assert len(simulations(os.getpid())) == 1
    del recorder
    assert not simulations(os.getpid())
    assert not list(places.iterdir())


def test_a_death_of_sumo_while_it_goes_on_is_one_plain_error(cross: World, places: Path) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as recorder:
        short = recorder.until(5.0)
        os.kill(simulations(os.getpid())[0], signal.SIGKILL)
        with pytest.raises(PaveTwinError, match="SUMO crashed") as caught:
            recorder.until(10.0)
        assert "\n" not in str(caught.value)
        assert not list(places.iterdir())
        assert short.path is not None
        assert not short.path.exists()
        assert recorder.until(10.0).until(5.0).same_traffic(short)  # another simulation repeats it
    assert not list(places.iterdir())


def test_simulations_at_the_same_time_share_nothing(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as first, Recorder(Inputs.of(cross, "low", 2)) as second:
        first.until(5.0)
        second.until(5.0)
        processes = simulations(os.getpid())
        assert [os.getsid(process) for process in processes] == processes, "each has a session of its own"
        for process in processes:
            held = [str(handle.readlink()) for handle in Path(f"/proc/{process}/fd").iterdir()]
            assert sum(handle.startswith("socket:") for handle in held) == 1, "the connection with its owner"
        longer = first.until(10.0), second.until(10.0)
    assert len(processes) == 2
    for seed, recording in enumerate(longer, start=1):
        assert recording.same_traffic(record(cross, "low", seed, 10.0, force=True))


def test_a_fork_of_the_owner_leaves_its_simulation_alone(cross: World) -> None:
    with Recorder(Inputs.of(cross, "low", 1)) as recorder:
        recorder.until(5.0)
        fork = os.fork()
        if fork == 0:
            recorder._end()
            os._exit(0)
        os.waitpid(fork, 0)
        assert recorder.until(10.0).duration_s == 10.0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_simulation_that_waits_ends_with_its_owner(cross: World, places: Path, number: signal.Signals) -> None:
    script = (
        "import sys, time; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from scenes.traffic import world_on\n"
        "from pavetwin.traffic.inputs import Inputs\n"
        "from pavetwin.traffic.record import Recorder\n"
        "with Recorder(Inputs.of(world_on(Path(sys.argv[1])), 'low', 1)) as recorder:\n"
        "    recorder.until(5.0)\n"
        "    print('recorded', flush=True)\n"
        "    time.sleep(60)\n"
    )
    owner = subprocess.Popen(
        [sys.executable, "-c", script, str(cross.network_file), str(Path(__file__).parents[1])],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "TMPDIR": str(places), "PYTHONPATH": str(SOURCES)},
    )
    assert owner.stdout is not None
    assert owner.stdout.readline() == "recorded\n"
    processes = simulations(owner.pid)
    assert len(processes) == 1
    assert list(places.iterdir())
    owner.send_signal(number)
    owner.wait(20)
    owner.stdout.close()
    assert is_over(lambda: not list(places.iterdir()))
    assert is_over(lambda: all(is_gone(process) for process in processes))
