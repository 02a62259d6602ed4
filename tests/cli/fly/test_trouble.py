"""`pavetwin fly` with full disks, damaged worlds, kills and interruptions."""

import os
import resource
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from pavetwin.traffic import tracks as part_table
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.command_line import SHORT, command, pavetwin, pavetwin_process, plain_refusal, without_progress
from scenes.folders import digests
from scenes.processes import is_gone, is_over, simulations


def test_a_flight_writes_into_the_cache_and_not_into_the_world(world: Path, tmp_path: Path) -> None:
    own = tmp_path / "cross"
    shutil.copytree(world, own)
    before = digests(own)
    done = pavetwin("fly", own, *SHORT, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    assert digests(own) == before
    assert {path.suffix for path in (tmp_path / "cache").rglob("*.*")} == {".parquet", ".npz"}


def test_a_world_that_cannot_be_written_is_flown_all_the_same(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pavetwin.mission.planning.os.access", lambda _path, mode: mode != os.W_OK)
    done = pavetwin("fly", world, *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "missions" / "cross").iterdir()] == [
        f"hover-low-1-10m-default-seed1-{next((tmp_path / 'missions' / 'cross').iterdir()).name[-6:]}"
    ]
    assert not (world / "missions").exists()


def test_a_half_deleted_world_is_named(world: Path, tmp_path: Path) -> None:
    for missing in ("world.gpkg", "world.yaml", "roads.net.xml"):
        broken = tmp_path / missing.replace(".", "-")
        shutil.copytree(world, broken)
        (broken / missing).unlink()
        assert missing in plain_refusal(pavetwin("fly", broken, *SHORT))
    assert "nowhere" in plain_refusal(pavetwin("fly", tmp_path / "nowhere", *SHORT))


def test_a_map_in_place_of_a_world_is_refused_with_the_command_that_builds_one(tmp_path: Path) -> None:
    (tmp_path / "my town.osm").write_text("<osm/>")
    line = plain_refusal(pavetwin("fly", "my town.osm", cwd=tmp_path))
    assert "is a map, not a world yet" in line
    assert "`pavetwin world build 'my town.osm' --output 'my town'`" in line
    assert "`pavetwin world build SOURCE --output town`" in plain_refusal(pavetwin("fly", "town", cwd=tmp_path))


def test_a_network_that_was_cut_short_is_named_with_a_fix(world: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(world, broken)
    whole = (broken / "roads.net.xml").read_bytes()
    (broken / "roads.net.xml").write_bytes(whole[: len(whole) // 2])
    line = plain_refusal(pavetwin("fly", broken, *SHORT))
    assert str(broken / "roads.net.xml") in line
    assert "pavetwin world build" in line


def test_a_trace_of_another_world_is_refused(world: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    save_world(built("cross", seed=2), other)
    trace = cached(load_world(world), "traffic/low-1.parquet")
    assert "world" in plain_refusal(pavetwin("fly", other, "--traffic", trace))


def test_a_folder_that_cannot_be_written_is_named(world: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    line = plain_refusal(pavetwin("fly", world, *SHORT, "-o", tmp_path / "file" / "m"))
    assert str(tmp_path / "file") in line
    assert "space" not in line
    line = plain_refusal(pavetwin("fly", world, *SHORT, "-o", "/proc/nothing/m"))
    assert "Cannot write '/proc/nothing/m': nothing can be made there. Choose another folder." in line
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_is_reported_and_leaves_nothing(world: Path, tmp_path: Path) -> None:
    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # else the kernel ends the process, unlike on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    line = plain_refusal(pavetwin_process("fly", world, *SHORT, "-o", tmp_path / "m", preexec_fn=no_room))
    assert "Cannot write" in line
    assert "Free some space" in line
    assert not list(tmp_path.iterdir())


def test_a_full_disk_during_a_recording_is_reported_and_leaves_nothing(world: Path, tmp_path: Path) -> None:
    def no_room() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))

    fly = ("fly", world, "--density", "high", "--segments", 1, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    line = plain_refusal(pavetwin_process(*fly, preexec_fn=no_room))
    assert "high-0.parquet" in line
    assert "Free some space" in line
    assert not (tmp_path / "m").exists()
    assert not list((tmp_path / "cache").rglob("*.parquet*"))
    assert is_over(lambda: not simulations(os.getpid()))


def test_a_damaged_recording_in_the_cache_is_made_again_with_one_warning(world: Path, tmp_path: Path) -> None:
    fly = ("fly", world, *SHORT, "--cache", tmp_path / "cache", "--force", "-o", tmp_path / "m")
    assert pavetwin(*fly).returncode == 0
    (path,) = (tmp_path / "cache").rglob("*.parquet")
    whole, mission = path.read_bytes(), digests(tmp_path / "m")["mission.parquet"]
    path.write_bytes(whole[: len(whole) // 2])
    done = pavetwin(*fly)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("was damaged or of another version; it was recorded again") == 1
    assert path.read_bytes() == whole
    assert digests(tmp_path / "m")["mission.parquet"] == mission
    assert "recorded again" not in pavetwin(*fly).stdout


@pytest.mark.slow
def test_a_killed_mission_leaves_nothing_half_written_and_is_flown_again(world: Path, tmp_path: Path) -> None:
    """A mission is not resumed: what was recorded and flown is lost, and the same command gives it."""
    arguments = ("fly", world, "--density", "high", "--segments", "all", "--policy", "skip")
    whole = pavetwin(*arguments, "--cache", tmp_path / "kept", "-o", tmp_path / "whole")
    assert whole.returncode == 0, whole.stderr
    again = command(*arguments, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    process = subprocess.Popen(again, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert is_over(lambda: bool(simulations(process.pid)))
    ran = simulations(process.pid)
    process.kill()
    process.wait()
    assert is_over(lambda: all(is_gone(each) for each in ran))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "kept", "whole"]
    done = pavetwin(*arguments, "--cache", tmp_path / "cache", "-o", tmp_path / "m")
    assert done.returncode == 0, done.stderr
    for name in ("mission.parquet", "track.parquet"):
        assert digests(tmp_path / "m")[name] == digests(tmp_path / "whole")[name]


INTERRUPTED, TERMINATED = (signal.SIGINT, 130, "Interrupted"), (signal.SIGTERM, 143, "Terminated")


@pytest.mark.parametrize(
    ("moment", "number", "code", "printed"),
    [
        ("recording", *INTERRUPTED),
        pytest.param("writing", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("recording", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("flying", *INTERRUPTED, marks=pytest.mark.slow),
        pytest.param("flying", *TERMINATED, marks=pytest.mark.slow),
        pytest.param("writing", *INTERRUPTED, marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_run_leaves_nothing_half_written(
    world: Path, tmp_path: Path, moment: str, number: signal.Signals, code: int, printed: str
) -> None:
    target = tmp_path / "cross"
    shutil.copytree(world, target)
    cache = tmp_path / "cache"
    before = set(digests(target))
    arguments = command(
        "fly", target, "--density", "high", "--segments", "all", "--policy", "all", "-o", tmp_path / "m"
    )
    process = subprocess.Popen(
        [*arguments, "--cache", str(cache)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    has_come = {
        "recording": lambda: simulations(process.pid),
        "flying": lambda: list(cache.rglob("high-0.parquet")),
        "writing": lambda: (tmp_path / "m").exists(),
    }[moment]
    assert is_over(lambda: bool(has_come()))
    process.send_signal(number)
    _, words = process.communicate(timeout=60)
    assert process.returncode == code, words
    assert words.splitlines()[-1] == f"Error: {printed}; no partial files are left."
    assert [path.name for path in tmp_path.iterdir() if path.name not in ("cache", "cross", "m")] == []
    for result in (tmp_path / "m").glob("*/"):  # missions that were whole by then
        assert {"mission.parquet", "track.parquet", "captures.geojson", "mission.yaml"} <= set(digests(result))
    assert not [name for name in digests(tmp_path) if Path(name).name.startswith(".")]
    assert set(digests(target)) == before


@pytest.mark.parametrize(("number", "code", "printed"), [INTERRUPTED, TERMINATED])
def test_an_interruption_while_the_kernel_has_traffic_read_is_one(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int, printed: str
) -> None:
    def interrupted(*_: object) -> None:
        signal.raise_signal(number)

    monkeypatch.setattr(part_table, "from_columns", interrupted)
    done = pavetwin("fly", world, *SHORT, "-o", tmp_path / "m")
    assert done.returncode == code, done.stderr
    assert without_progress(done.stderr) == [f"Error: {printed}; no partial files are left."]
    assert not list(tmp_path.iterdir())


def test_an_error_without_a_message_shows_its_type(world: Path, tmp_path: Path) -> None:
    plugin = tmp_path / "silent.py"
    plugin.write_text("from pavetwin.errors import PaveTwinError\nraise PaveTwinError from TimeoutError()\n")
    line = plain_refusal(pavetwin("fly", world, *SHORT, "--plugin", plugin, "-o", tmp_path / "m"))
    assert line == "Error: TimeoutError without a message."
