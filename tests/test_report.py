"""What a command writes and prints of missions: numbers before pictures, and tables that fit a page."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import polars as pl
import pytest

from pavetwin.cli import report
from pavetwin.draw import mission_map
from pavetwin.errors import PaveTwinError
from pavetwin.mission.fly import Flown
from pavetwin.mission.results import save_mission, save_missions
from scenes import tiny

NUMBERS = {"mission.parquet", "track.parquet", "captures.geojson", "mission.yaml"}
REPLAY: Any = SimpleNamespace()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def save(missions: Iterator[Flown] | list[Flown], folder: Path, *, several: bool) -> list[Flown]:
    return report.save(missions, REPLAY, folder, several=several, animated=lambda _: False)


@pytest.mark.parametrize("error", [ValueError("one point is no line"), PaveTwinError("No segment in common.")])
def test_a_picture_that_fails_leaves_the_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(mission_map, "save_mission_map", fail)
    flown = tiny.flown("lively_street", "hover")
    with pytest.raises(PaveTwinError, match=r"map\.png.*" + str(error)) as said:
        save([flown], tmp_path / "m", several=False)
    assert "The numbers are in" in str(said.value) or "the numbers are in" in str(said.value)
    assert "\n" not in str(said.value)
    assert names(tmp_path / "m") == NUMBERS
    with pytest.raises(PaveTwinError, match=r"hover/map\.png"):
        save([flown, tiny.flown("lively_street", "skip")], tmp_path / "all", several=True)
    assert names(tmp_path / "all") == {"hover", "skip", "mission.parquet", "comparison.png"}
    assert names(tmp_path / "all" / "skip") == NUMBERS


def test_an_interrupted_drawing_leaves_the_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mission_map, "save_mission_map", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save([tiny.flown("lively_street", "hover")], tmp_path / "m", several=False)
    assert names(tmp_path / "m") == NUMBERS


def test_a_flight_that_ends_badly_costs_none_before_it(tmp_path: Path) -> None:
    def missions() -> Iterator[Flown]:
        yield tiny.flown("lively_street", "baseline")
        yield tiny.flown("lively_street", "hover")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        save(missions(), tmp_path / "all", several=True)
    assert names(tmp_path / "all") == {"baseline", "hover", "mission.parquet"}
    assert pl.read_parquet(tmp_path / "all" / "mission.parquet")["policy"].to_list() == ["baseline", "hover"]
    assert names(tmp_path / "all" / "hover") == {*NUMBERS, "map.png"}


def test_a_mission_has_the_same_bytes_alone_and_among_others(tmp_path: Path) -> None:
    missions = [tiny.flown("lively_street", policy) for policy in ("baseline", "micro")]
    save(missions, tmp_path / "all", several=True)
    save(missions[1:], tmp_path / "alone", several=False)
    assert digests(tmp_path / "all" / "micro") == digests(tmp_path / "alone")


def test_nothing_of_a_former_mission_stays(tmp_path: Path) -> None:
    flown = tiny.flown("lively_street", "hover")

    def moving(_: Flown, path: Path) -> None:
        path.write_bytes(b"GIF89a")

    save_mission(flown, tmp_path / "m", [("mission.gif", moving)])
    assert names(tmp_path / "m") == {*NUMBERS, "mission.gif"}
    save_missions([(flown, [])], tmp_path / "m")
    assert names(tmp_path / "m") == {"hover", "mission.parquet"}
    save_mission(flown, tmp_path / "m")
    assert names(tmp_path / "m") == NUMBERS
