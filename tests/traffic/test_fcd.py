"""Stretches of recordings as floating car data."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.recording_file import export_fcd, save_recording
from scenes.command_line import pavetwin, plain_refusal
from scenes.recordings import Pose, recording


def east_then_north(agent: int, t: float) -> Pose:
    """The first drives east at 10 m/s, the second walks north at 1 m/s."""
    return (10 * t, 5.0, 0.0, 10.0) if agent == 0 else (-3.0, t, np.pi / 2, 1.0)


@pytest.fixture
def long(tmp_path: Path) -> Recording:
    """Of three parts."""
    made = recording(("van", "man"), east_then_north, frames=601)
    return save_recording(made, tmp_path / "long.parquet")


def test_rows_are_those_of_fcd(long: Recording, tmp_path: Path) -> None:
    assert export_fcd(long, tmp_path / "all.parquet") == 2 * long.frames
    table = pl.read_parquet(tmp_path / "all.parquet")
    assert table.columns[:7] == ["time", "id", "type", "x", "y", "angle", "speed"]
    van, man = (table.filter(pl.col("type") == kind) for kind in ("van", "man"))
    half_m = long.agents.length_m[0] / 2
    np.testing.assert_allclose(van["time"], np.arange(long.frames) * long.step_s)
    np.testing.assert_allclose(van["x"], 10 * van["time"].to_numpy() + half_m, atol=2e-3)
    assert van["angle"].unique().to_list() == [90.0]
    assert man["angle"].unique().to_list() == [0.0]
    np.testing.assert_allclose(man["y"], man["time"], atol=2e-3)
    assert (van["class"].unique().to_list(), man["class"].unique().to_list()) == (["vehicle"], ["pedestrian"])


@pytest.mark.parametrize(("start_s", "end_s"), [(0.0, 0.0), (0.0, 7.5), (110.0, 130.5), (240.0, 300.0), (60.0, 60.0)])
def test_a_stretch_is_that_of_the_whole(long: Recording, tmp_path: Path, start_s: float, end_s: float) -> None:
    export_fcd(long, tmp_path / "all.parquet")
    export_fcd(long, tmp_path / "some.csv", start_s, end_s)
    whole, some = pl.read_parquet(tmp_path / "all.parquet"), pl.read_csv(tmp_path / "some.csv")
    expected = whole.filter(pl.col("time").is_between(start_s, end_s))
    assert some.height == expected.height == 2 * ((end_s - start_s) * 2 + 1)
    for name in ("time", "x", "y", "angle", "speed"):
        np.testing.assert_allclose(some[name], expected[name], atol=1e-9)
    assert some["id"].cast(str).to_list() == expected["id"].to_list()


def test_what_is_not_in_it_is_refused(long: Recording, tmp_path: Path) -> None:
    for start_s, end_s in ((-1.0, 5.0), (5.0, 4.0), (0.0, 300.5), (float("nan"), 5.0)):
        with pytest.raises(PaveTwinError, match="lasts from 0 to 300 s"):
            export_fcd(long, tmp_path / "x.csv", start_s, end_s)
    file = long.path
    assert "must end in .parquet or .csv" in plain_refusal(pavetwin("traffic", "export", file, tmp_path / "x.txt"))
    assert "There is no recording" in plain_refusal(pavetwin("traffic", "export", tmp_path / "no", tmp_path / "x.csv"))
    assert not list(tmp_path.glob("x.*"))
    done = pavetwin("traffic", "export", file, tmp_path / "x.csv", "--from", 10, "--to", 12)
    assert "10 rows in" in done.stdout


@pytest.mark.parametrize(
    ("start_s", "end_s", "times"), [(0.25, 1.2, [0.5, 1.0]), (0.3, 0.9, [0.5]), (0.5, 0.5, [0.5]), (0.0, 0.49, [0.0])]
)
def test_a_stretch_holds_the_moments_within_it_alone(
    long: Recording, tmp_path: Path, start_s: float, end_s: float, times: list[float]
) -> None:
    export_fcd(long, tmp_path / "some.csv", start_s, end_s)
    some = pl.read_csv(tmp_path / "some.csv").filter(pl.col("type") == "man")
    assert some["time"].to_list() == some["y"].to_list() == times


def test_a_stretch_between_two_moments_is_refused(long: Recording, tmp_path: Path) -> None:
    with pytest.raises(PaveTwinError, match=r"No moment of the recording lies from 0.3 to 0.4 s: it has one every 0.5"):
        export_fcd(long, tmp_path / "x.csv", 0.3, 0.4)
    assert not list(tmp_path.glob("x.*"))


def test_a_recording_and_other_files_are_not_replaced_by_themselves(long: Recording, tmp_path: Path) -> None:
    assert long.path is not None
    before = long.path.read_bytes()
    (tmp_path / "link.parquet").symlink_to(long.path)
    (tmp_path / "there.csv").write_text("mine")
    for target in (long.path, tmp_path / "there.csv"):
        told = plain_refusal(pavetwin("traffic", "export", long.path, target))
        assert "exists; choose another name, or add --force" in told
    for target in (long.path, tmp_path / "link.parquet"):
        with pytest.raises(PaveTwinError, match="it is the recording itself, which this would replace"):
            export_fcd(long, target)
    assert (tmp_path / "there.csv").read_text() == "mine"
    assert long.path.read_bytes() == before
    assert pavetwin("traffic", "export", long.path, tmp_path / "there.csv", "--force").returncode == 0
