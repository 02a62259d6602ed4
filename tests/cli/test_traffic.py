"""`pavetwin traffic` as a user types it: the summary, and one plain line with exit code 2 for what is wrong."""

from pathlib import Path

import pytest

from pavetwin.traffic.recording_file import load_recording
from pavetwin.world.build import BuildOptions, build_world
from pavetwin.world.cache import cached
from pavetwin.world.store import load_world, save_world
from scenes.command_line import pavetwin, plain_refusal
from scenes.traffic import make_network


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli")
    net_file = make_network("cross", folder / "net" / "cross.net.xml")
    save_world(build_world(net_file, BuildOptions(anchor=(48.1, 11.5))), folder / "cross")
    return folder / "cross"


def test_recording_says_what_it_did_and_then_that_it_is_done(world: Path, tmp_path: Path) -> None:
    first = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 30)
    assert first.returncode == 0, first.stderr
    assert "× real time" in first.stdout
    assert "vehicles per lane-km" in first.stdout
    file = cached(load_world(world), "traffic/low-1.parquet")
    assert str(file) in first.stdout
    assert load_recording(file).duration_s == 30.0
    assert not (world / "traffic").exists()
    again = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 10)
    assert "Taken from the cache" in again.stdout
    own = tmp_path / "mine" / "low.parquet"
    written = pavetwin("traffic", "record", world, "--density", "low", "--seed", 1, "--duration", 10, "-o", own)
    assert f"File: {own}" in written.stdout
    assert load_recording(own).duration_s == 10.0
    info = pavetwin("traffic", "info", file)
    assert info.returncode == 0
    assert "low traffic, seed 1, 30 s" in info.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--density", "hihg"), "did you mean 'high'?"),
        (("--density", "low", "--duration", "0"), "duration"),
        (("--density", "low", "--duration", "-3"), "duration"),
        (("--density", "low", "--seed", "-1"), "seed"),
        ((), "an amount of traffic"),
        (("--density", "low", "--vehicles-per-lane-km", "3"), "Choose one"),
        (("--vehicles-per-lane-km", "-3"), "from 0 up"),
        (("--vehicles-per-lane-km", "500"), "do not fit"),
        (("--routes", "nowhere.rou.xml"), "nowhere.rou.xml"),
    ],
)
def test_what_is_wrong_is_one_plain_line(world: Path, arguments: tuple[str, ...], words: str) -> None:
    before = sorted(world.rglob("*"))
    assert words in plain_refusal(pavetwin("traffic", "record", world, *arguments))
    assert sorted(world.rglob("*")) == before


def test_a_world_or_a_recording_that_is_none(tmp_path: Path) -> None:
    for arguments in (("record", tmp_path / "none", "--density", "low"), ("info", tmp_path / "none.parquet")):
        plain_refusal(pavetwin("traffic", *arguments))
