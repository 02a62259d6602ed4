"""Every benchmark runs on the smallest input; no test asserts a time."""

import json
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import create_autospec

import pytest
from benchmarks import (
    commands,
    frames,
    images,
    machine,
    page,
    process,
    streets,
    surveys,
    worlds,
)
from benchmarks.__main__ import GROUPS, main, measure
from benchmarks.measure import Kind, Line, Size
from benchmarks.table import as_json, notes, plot, table
from rich.console import Console

from pavetwin.mission.replay import replay_of
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.command_line import pavetwin
from scenes.traffic import make_network

SMOKE = Size(
    segments=1,
    runs=1,
    recorded_s=340.0,
    crowd_s=5.0,
    few=1,
    mapped=1,
    survey=1,
    images=1,
    crowd=20,
    shapes=3,
    places=1,
    frame_px=(96, 96),
    photographs=2,
    batch=2,
    copies=2,
    streets_m=(200.0, 300.0),
    study={"replicates": 1, "densities": ["high"], "altitudes_m": [10], "policies": ["hover"]},
)
"""The least that every measurement takes."""


@pytest.mark.parametrize(
    ("value", "kind", "target", "reached"),
    [
        (2.0, Kind.SECONDS, 3.0, True),
        (4.0, Kind.SECONDS, 3.0, False),
        (4000.0, Kind.REAL_TIME, 3000.0, True),
        (2000.0, Kind.REAL_TIME, 3000.0, False),
        (120.0, Kind.PER_SECOND, 100.0, True),
        (1.2, Kind.RATIO, 1.5, True),
        (9.0, Kind.MEBIBYTES, None, None),
        (None, Kind.PER_SECOND, 60.0, None),
    ],
)
def test_a_line_knows_whether_its_target_is_reached(
    value: float | None, kind: Kind, target: float | None, reached: bool | None
) -> None:
    assert Line("it", value, kind, target).reached is reached


def test_streets_are_measured_tabled_and_drawn(tmp_path: Path) -> None:
    measured = list(streets.lines(replace(SMOKE, streets_m=(1000.0,))))
    assert all(line.value > 0 for line in measured)
    assert [line.target for line in measured] == [3.0, 0.2e-3, 0.2e-3]
    lines = [replace(line, value=line.target) for line in measured]
    console = Console(width=100, record=True)
    console.print(table(lines))
    shown = console.export_text()
    assert "NavMesh of 1 km² of streets [1]" in shown
    assert shown.count(" yes ") == 3
    assert notes(lines)[0].startswith("[1] 20 streets")
    assert json.loads(json.dumps(as_json(machine.describe(), lines)))["lines"][0]["reached"] is True
    plot(lines, tmp_path / "plot.svg")
    assert "NavMesh of 1 km² of streets" in (tmp_path / "plot.svg").read_text("utf-8")


def test_a_world_that_is_not_there_is_one_plain_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--quick", "--world", str(tmp_path / "nowhere"), "--json", str(tmp_path / "out.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out.json").exists()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], list[Line], Path]:
    """The parts that were begun, all lines, and the folder, over a world of one short street."""
    folder = tmp_path_factory.mktemp("benchmarks")
    network = make_network("short", folder / "roads.net.xml")
    begun: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, "")
        patch.setattr(os, "cpu_count", lambda: 1)  # the study without worker processes
        # Real frames take 17 s of processor time, see the slow test; here their calls are checked.
        renderer = create_autospec(frames.Renderer)
        renderer.return_value.gpu = SimpleNamespace(held_bytes=2**20)
        patch.setattr(frames, "Renderer", renderer)
        patch.setattr(frames, "find_adapter", lambda: "none")
        # Whole commands take seconds each; here their words are checked.
        for module in (commands, surveys, images):
            patch.setattr(module, "run", partial(checked, folder / "cache"))
        # A browser and tiles take a minute; see the slow test.
        patch.setattr(page, "chromium", lambda: None)
        patch.setattr(page, "WebTown", create_autospec(page.WebTown))
        built = worlds.build(folder / "short", network, defects_per_segment=3)
        lines = [built, *measure(folder / "short", SMOKE, folder, begun.append)]
    return begun, lines, folder


def checked(cache: Path, words: Sequence[str]) -> process.Used:
    """Nothing is done; the words are checked, and a file of each command is in the cache."""
    end = ["--help"] if words[0] in ("capture", "world") else ["--settings"]
    cache.joinpath(f"{'-'.join(Path(word).name for word in words)}.parquet").write_bytes(b"recording")
    return process.Used(float(not pavetwin(*words, *end).returncode), 1.0, 1.0)


@pytest.mark.slow
def test_every_part_measures_something(measured: tuple[list[str], list[Line], Path]) -> None:
    begun, lines, _ = measured
    assert begun == list(GROUPS)
    absent = {line.what for line in lines if line.value is None and line.kind is not Kind.SECONDS}
    assert all("training" in what for what in absent)
    values = [line.value for line in lines if line.value is not None and line.kind is not Kind.SECONDS]
    assert all(math.isfinite(value) and value > 0 for value in values)
    Console(width=100, record=True).print(table(lines))
    assert len({line.what for line in lines}) > 2 * len(GROUPS)
    assert next(line for line in lines if line.what == "pavetwin fly, segments: 1, high traffic recorded").value == 1.0


def test_a_group_can_be_measured_alone(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "")
    begun: list[str] = []
    lines = [*measure(None, replace(SMOKE, streets_m=(200.0,)), tmp_path, begun.append, ["streets"])]
    assert begun == ["streets"]
    assert lines[0].what.startswith("NavMesh")
    with pytest.raises(SystemExit):
        main(["--only", "street"])
    assert "invalid choice: 'street'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_frames_are_measured(measured: tuple[list[str], list[Line], Path]) -> None:
    world = load_world(measured[2] / "short")
    replay = replay_of(world, "high", 1)
    lines = list(frames.lines(world, replay, SMOKE))
    assert {line.what for line in lines} <= {line.what for line in measured[1]}
    assert all(line.value > 0 for line in lines)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.needs_adapter
def test_the_page_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if page.chromium() is None:
        pytest.skip("no browser")
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    save_world(damaged("cross", 8), tmp_path / "cross")
    lines = list(page.lines(tmp_path / "cross", tmp_path, SMOKE))
    assert all(line.value is None or line.value > 0 for line in lines)
    assert {line.what for line in lines if line.value is None} <= {"the town in 3-D at 1920 × 1080 px on a GPU"}
    assert sum(line.target is not None for line in lines) >= 14
    (calls,) = (line for line in lines if line.what == "its draw calls")
    assert calls.reached
