"""Recording once: the cache, the prefix law, the same bytes, a user's own routes, and what an interruption leaves."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.mission.replay import Replay
from pavetwin.traffic.demand import density_of
from pavetwin.traffic.inputs import Inputs
from pavetwin.traffic.record import Recorder, record
from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.cache import cached
from pavetwin.world.model import World
from scenes.traffic import ROUTES, SOURCES, bytes_of, scene_world, world_on


@pytest.fixture
def cross(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> World:
    monkeypatch.setenv("PAVETWIN_CACHE", str(tmp_path / "cache"))
    return scene_world("cross", tmp_path)


def reported(shares: list[float]) -> Callable[[float], None]:
    return shares.append


def test_the_same_seed_gives_the_same_bytes_and_another_gives_others(cross: World) -> None:
    first = bytes_of(record(cross, "medium", 0, 20.0))
    assert bytes_of(record(cross, "medium", 0, 20.0, force=True)) == first
    assert bytes_of(record(cross, "medium", 1, 20.0)) != first


def test_traffic_runs_on_lanes_with_ids_of_the_users_own(cross: World) -> None:
    plain = record(cross, "low", 3, 20.0)
    text = cross.network_file.read_text(encoding="utf-8")
    for old, new in (("wc_0", "footway"), ("wc_1", "west-7"), (":c_c0_0", ":zebra"), (":c_w0_0", ":corner")):
        text, count = re.subn(rf"(?<!\w){old}\b", new, text)
        assert count
    cross.network_file.write_text(text, encoding="utf-8")
    renamed = record(world_on(cross.network_file), "low", 3, 20.0)
    assert renamed.origin.inputs != plain.origin.inputs
    assert renamed.agents.id == plain.agents.id
    np.testing.assert_array_equal(renamed.x, plain.x)


def test_what_was_recorded_is_used_again(cross: World) -> None:
    shares: list[float] = []
    first = record(cross, "low", 3, 20.0, on_progress=reported(shares))
    assert first.path == cached(cross, "traffic/low-3.parquet")
    assert [path.name for path in cross.network_file.parent.iterdir()] == ["roads.net.xml"]
    assert shares[-1] == 1.0
    assert shares == sorted(shares)
    shares.clear()
    assert record(cross, "low", 3, 20.0, on_progress=reported(shares)).same_traffic(first)
    assert not shares
    record(replace(cross, content_hash="rebuilt"), "low", 3, 20.0, on_progress=reported(shares))
    assert shares
    with pytest.raises(PaveTwinError, match="another world"):
        load_recording(Inputs.of(cross, first.origin.asked, 3).path, replace(cross, content_hash="rebuilt"))


def test_a_recording_that_a_mission_names_is_extended_elsewhere(cross: World) -> None:
    """A mission names it with its hash, which must still fit when the mission is flown again."""
    made = record(cross, "low", 4, 10.0).path
    assert made is not None
    own = cross.network_file.parent / "traffic" / "low-4.parquet"
    own.parent.mkdir(exist_ok=True)
    shutil.copy(made, own)
    for file in (made, own):
        before = file.read_bytes()
        with Replay(cross, load_recording(file, cross), file=file) as replay:
            assert replay.extend(20.0).duration_s > 20.0
        assert file.read_bytes() == before


def test_what_comes_back_does_not_depend_on_how_long_the_file_is(cross: World) -> None:
    short = record(cross, "medium", 5, 15.0)
    with Recorder.of(short, cross) as recorder:
        long = recorder.until(40.0)
    assert long.duration_s == 40.0
    assert long.until(15.0).same_traffic(short)
    assert not long.until(15.0).same_traffic(long)
    again = record(cross, "medium", 5, 15.0)
    assert again.same_traffic(short)
    assert again.vehicles_per_lane_km == short.vehicles_per_lane_km
    assert load_recording(Inputs.of(cross, short.origin.asked, 5).path).duration_s == 40.0


def test_a_recording_of_another_world_is_not_extended(cross: World) -> None:
    recording = record(cross, "low", 1, 10.0)
    with pytest.raises(PaveTwinError, match="cannot be extended"):
        Recorder.of(recording, replace(cross, content_hash="rebuilt"))


def test_a_damaged_file_is_recorded_again(cross: World) -> None:
    first = record(cross, "low", 1, 10.0)
    before = bytes_of(first)
    assert first.path is not None
    first.path.write_bytes(before[: len(before) // 2])
    assert bytes_of(record(cross, "low", 1, 10.0)) == before


def test_no_traffic_at_all_is_traffic_too(cross: World) -> None:
    empty = record(cross, density_of(0, 0), 1, 10.0)
    assert len(empty.agent) == 0
    assert empty.frames == 21
    assert empty.vehicles_per_lane_km == 0.0


def test_a_users_routes_are_driven_as_they_are(cross: World, tmp_path: Path) -> None:
    routes = tmp_path / "mine.rou.xml"
    routes.write_text(ROUTES)
    recording = record(cross, None, 1, 40.0, routes=[routes])
    assert recording.path is not None
    assert recording.path.name == "user-mine-1.parquet"
    agents = recording.agents
    assert dict(zip(agents.id, agents.kind, strict=True)).items() >= {("2", "passenger"), ("taxi", "passenger")}
    lorry = agents.kind.index("truck")
    assert (agents.length_m[lorry], agents.width_m[lorry]) == pytest.approx((8.5, 2.4))
    assert agents.height_m[lorry] == pytest.approx(3.2)
    plain = agents.kind.index("passenger")
    assert agents.length_m[plain] == pytest.approx(5.0)  # SUMO's own car
    assert sorted(agents.id) == ["1", "1", "2", "rider", "taxi"]  # a person and a lorry share the name 1
    assert recording.counts[0][2] >= 1  # the clock starts with the first departure, not at midnight
    assert recording.name == "user"
    rider = agents.id.index("rider")
    last = int(np.flatnonzero(recording.agent == rider)[-1])
    assert np.searchsorted(recording.step_offsets, last, side="right") - 1 < 40  # inside the taxi she is not on foot
    routes.write_text(ROUTES.replace('depart="3601"', 'depart="3601.5"'))
    shares: list[float] = []
    record(cross, None, 1, 40.0, routes=[routes], on_progress=reported(shares))
    assert shares
    assert "routes end early" in record(cross, None, 1, 300.0, routes=[routes]).remarks[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<routes><vehicle id='1'", "not valid XML"),
        ("<routes><vehicle id='1' depart='0'><route edges='wc nowhere'/></vehicle></routes>", "nowhere"),
        ("<routes><vehicle id='1' depart='0'><route edges='wc ec'/></vehicle></routes>", "wc"),
        (
            "<routes><vehicle id='1' depart='9'><route edges='wc ce'/></vehicle>"
            "<vehicle id='2' depart='0'><route edges='wc ce'/></vehicle></routes>",
            "not sorted",
        ),
        ("<routes><vehicle id='1' type='none' depart='0'><route edges='wc ce'/></vehicle></routes>", "none"),
    ],
)
def test_broken_routes_are_refused_in_sumos_words(cross: World, tmp_path: Path, text: str, words: str) -> None:
    routes = tmp_path / "bad.rou.xml"
    routes.write_text(text)
    with pytest.raises(PaveTwinError, match=words) as caught:
        record(cross, None, 1, 10.0, routes=[routes])
    assert "\n" not in str(caught.value)
    assert not list(cross.network_file.parent.parent.rglob("*.parquet"))


@pytest.mark.parametrize("duration", [0.0, -5.0, float("nan"), float("inf")])
def test_an_invalid_duration_is_refused(cross: World, duration: float) -> None:
    with pytest.raises(PaveTwinError, match="duration"):
        record(cross, "low", 1, duration)


@pytest.mark.parametrize("traffic", ["low", "los-C"])
def test_an_unwritable_folder_is_found_before_the_simulation(cross: World, traffic: str) -> None:
    folder = Inputs.of(cross, traffic, 1).path.parent
    folder.parent.mkdir(parents=True)
    folder.write_text("in the way")
    shares: list[float] = []
    with pytest.raises(PaveTwinError, match=r"Cannot write.*PAVETWIN_CACHE names one"):
        record(cross, traffic, 1, 10.0, on_progress=reported(shares), on_search=reported(shares))
    assert not shares


def test_missing_sumo_is_named(cross: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pavetwin.traffic.runner.find_spec", lambda name: None)  # noqa: ARG005
    with pytest.raises(PaveTwinError, match="pip install"):
        record(cross, "low", 1, 10.0)


def test_a_crash_of_sumo_ends_only_sumo(cross: World) -> None:
    cross.network_file.write_text("<net version='1.20'><edge id='half'")
    with pytest.raises(PaveTwinError) as caught:
        record(cross, "low", 1, 10.0)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_an_interruption_leaves_nothing(cross: World, tmp_path: Path, number: signal.Signals, code: int) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    script = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from scenes.traffic import world_on\n"
        "from pavetwin.traffic.record import record\n"
        "try:\n"
        "    world = world_on(Path(sys.argv[1]))\n"
        "    record(world, 'high', 1, 36000, on_progress=lambda share: print(share, flush=True))\n"
        "except KeyboardInterrupt:\n"
        "    sys.exit(130)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(cross.network_file), str(Path(__file__).parents[1])],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(SOURCES)},
    )
    assert process.stdout is not None
    assert process.stdout.readline()  # the simulation is under way
    assert len(list(temporary.iterdir())) == 1
    process.send_signal(number)
    assert process.wait(20) == code
    process.stdout.close()
    patience = time.monotonic() + 20
    while list(temporary.iterdir()) and time.monotonic() < patience:  # after kill -9 SUMO's process tidies up
        time.sleep(0.1)
    assert not list(temporary.iterdir())
    assert not list(cross.network_file.parent.parent.rglob("*.parquet"))
