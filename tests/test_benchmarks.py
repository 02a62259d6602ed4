"""The benchmarks' own arithmetic, and every measurement on the smallest input, without a word on its speed."""

import ast
import inspect
import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import create_autospec

import numpy as np
import polars as pl
import pytest
from benchmarks import __main__ as program
from benchmarks import (
    commands,
    coverage,
    day,
    frames,
    images,
    learning,
    machine,
    page,
    pairs,
    process,
    serving,
    startup,
    streets,
    study_pairs,
    surveys,
    waiting,
    worlds,
)
from benchmarks.__main__ import GROUPS, main, measure
from benchmarks.measure import Kind, Line, Size, median_s
from benchmarks.table import as_json, notes, table
from PIL import Image
from rich.console import Console

from pavetwin.errors import PaveTwinError
from pavetwin.mission.replay import replay_of
from pavetwin.world.folder import CACHE_VARIABLE
from pavetwin.world.store import load_world, save_world
from scenes import damaged
from scenes.command_line import pavetwin
from scenes.drawn_detector import FILE
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


def test_values_are_shown_with_their_unit() -> None:
    assert Kind.SECONDS.shown(2.5e-6) == "2.5 µs"
    assert Kind.SECONDS.shown(0.2165) == "216 ms"
    assert Line("it", 30312.0, Kind.REAL_TIME, 3000.0, took_s=0.009).measured() == "9 ms, 30,312 ×"
    assert Line("it", 1.0, Kind.REAL_TIME, 3000.0).asked() == "≥ 3,000 ×"
    assert Line("it", None, Kind.PER_SECOND, 60.0).measured() == "not here"


def test_the_median_leaves_the_warm_up_out() -> None:
    calls: list[int] = []
    assert median_s(lambda: calls.append(1), runs=3, warm_up=2) >= 0
    assert len(calls) == 5


def test_streets_are_measured_and_tabled() -> None:
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


def test_starting_is_measured_in_processor_time() -> None:
    lines = list(startup.lines(runs=1))
    assert [line.what for line in lines] == [
        *("pavetwin --version", "pavetwin fly, a misspelt world", "pavetwin fly --help", "import pavetwin")
    ]
    assert all(line.value > 0 for line in lines)
    assert [line.target for line in lines] == [0.2, 0.6, None, None]


def test_a_command_that_fails_is_no_measurement() -> None:
    with pytest.raises(PaveTwinError, match=r"`pavetwin fly no-such-world` failed: Error: "):
        process.run(["fly", "no-such-world"])


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


def test_where_pytorch_is_not_installed_no_time_of_training_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning, "find_spec", {}.get)
    lines = list(learning.lines(tmp_path, SMOKE))
    assert [line.what.rpartition(" in ")[2] for line in lines] == ["bfloat16", "single precision"]
    assert {line.measured() for line in lines} == {"not here"}


def test_what_a_command_took_is_that_of_its_process() -> None:
    used = process.run([], code="bytearray(300 * 2**20); sum(range(2_000_000))")
    assert used.peak_mib > 300
    assert used.processor_s > 0


def test_the_memory_of_a_command_is_not_that_of_who_starts_it() -> None:
    held = bytearray(400 * 2**20)
    assert process.run([], code="pass").peak_mib < 100
    assert len(held) == 400 * 2**20


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


def line_functions() -> set[str]:
    """Module and name of every function of the benchmarks that gives lines."""
    names: set[str] = set()
    for path in sorted(Path(worlds.__file__).parent.glob("*.py")):
        functions = [
            node for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)
        ]
        given = [node.name for node in functions if node.returns and re.search(r"\bLine\b", ast.unparse(node.returns))]
        names |= {f"{path.stem}.{name}" for name in given if not name.startswith("_")}
    return names - {"__main__.measure"}


def test_every_line_function_is_measured() -> None:
    called = {
        ast.unparse(node.func) for node in ast.walk(ast.parse(inspect.getsource(program))) if isinstance(node, ast.Call)
    }
    assert len(line_functions()) >= 11
    assert line_functions() - called == set()


def test_what_a_bar_tells_is_compared_with_what_came() -> None:
    shown = (
        "\x1b[2KFlying skip, recording more traffic \x1b[91m━━━\x1b[0m\x1b[90m╺━━\x1b[0m  52 % \x1b[36m0:02:05\x1b[0m"
    )
    said = [(10.0, "Recording traffic ━━━  99 % 0:00:01"), (20.0, shown), (120.0, "Flying skip ━━━ 100 % 0:00:00")]
    assert day.times_left(said) == [(20.0, 125.0, 100.0), (120.0, 0.0, 0.0)]


def test_memory_of_a_command_is_drawn_and_kept(tmp_path: Path) -> None:
    kept, picture = tmp_path / "day.json", tmp_path / "day.png"
    assert day.main(["-o", str(picture), "--json", str(kept), "fly", "--help"]) == 0
    measured = json.loads(kept.read_text())
    assert max(own for _, own, _ in measured["memory"]) > 5
    assert picture.read_bytes()[:4] == b"\x89PNG"
    picture.unlink()
    assert day.main(["-o", str(picture), "--from", str(kept)]) == 0
    assert picture.exists()


def test_pairs_give_the_median_ratio_with_its_interval() -> None:
    ratios = [0.5, 0.9, 0.9, 1.0, 1.0, 1.1, 1.1, 1.2, 1.2, 3.0]
    found = [(pairs.Cost(0.1, 0.02), pairs.Cost(0.1 * ratio, 0.03)) for ratio in ratios]
    row = pairs.table({"a frame": found}).splitlines()[2]
    assert row == "| a frame | 100 ms | 105 ms | 1.05 (0.90 to 1.20) | 20 ms; 30 ms |"


class Answering(pairs.Checkout):
    """Costs as many seconds as works were asked of it."""

    def __init__(self, log: list[str], name: str) -> None:
        self.log, self.name = log, name

    def order(self, order: str, place: int, what: str = "") -> None:
        self.log.append(f"{self.name} {order} {place} {what}".strip())

    def answer(self) -> Any:
        return [1.0, 0.0] if self.log and "time" in self.log[-1] else ["a", "b"]


def test_pairs_take_turns_at_each_work_and_stay_at_a_place() -> None:
    log: list[str] = []
    found = pairs.compare(Answering(log, "old"), Answering(log, "new"), 2, 2, lambda _share, _what: None)
    assert {what: len(each) for what, each in found.items()} == {"a": 4, "b": 4}
    first = [*("old warm 0", "new warm 0", "old time 0 a", "new time 0 a", "old time 0 b", "new time 0 b")]
    second = ["new time 0 a", "old time 0 a", "new time 0 b", "old time 0 b"]
    assert log[:10] == first + second
    assert log[10:] == [line.replace(" 0", " 1") for line in log[:10]]


def test_pairs_say_that_a_checkout_cannot_measure(tmp_path: Path) -> None:
    """A folder that holds no package: this interpreter's own is taken, which cannot open the world."""
    with pytest.raises(SystemExit, match="cannot measure"):
        pairs.main([str(tmp_path), str(tmp_path / "no-world")])


def test_cells_of_two_studies_are_compared_replicate_by_replicate() -> None:
    def missions(of_cells: dict[str, list[float]]) -> pl.DataFrame:
        rows = [
            (name, 10.0, "skip", replicate, value)
            for name, values in of_cells.items()
            for replicate, value in enumerate(values)
        ]
        return pl.DataFrame(rows, schema=[*study_pairs.CELL, "replicate", "coverage"], orient="row")

    before = missions({"low": [80.0, 84.0], "high": [60.0, 70.0, 66.0, math.nan]})
    now = missions({"low": [82.0, 82.0], "high": [69.0, 80.0, 77.0, 99.0]})
    found = study_pairs.compared(before, now, "coverage")
    # High: 9, 10 and 11 apart, so 10 by a standard error of 1 over the root of 3; low: 2 and -2 apart.
    assert found == ("coverage", pytest.approx(10.0), pytest.approx(10 * math.sqrt(3)), 1, 2)
    assert study_pairs.compared(now, now, "coverage")[1:4] == (0.0, 0.0, 0)
    with pytest.raises(ValueError, match="same cells"):
        study_pairs.compared(before, now.filter(pl.col("traffic") == "low"), "coverage")
    with pytest.raises(ValueError, match="two replicates"):
        study_pairs.compared(before, now.filter(pl.col("replicate") == 0), "coverage")


@pytest.mark.slow
def test_what_waits_correlate_with_is_counted(
    measured: tuple[list[str], list[Line], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    waiting.main([str(measured[2] / "from nothing"), "--altitude", "10"])
    printed = capsys.readouterr().out
    assert "are on the fullest fifth" in printed
    assert "of 1 segments hold five standing vehicles or more" in printed


@pytest.mark.filterwarnings("ignore")  # scipy's, about samples that do not vary
def test_the_coverage_of_intervals_is_tabled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in {"SAMPLES": 4, "RESAMPLES": 99, "BATCH": 2, "PAIRS": 6}.items():
        monkeypatch.setattr(coverage, name, value)
    coverage.main()
    printed = capsys.readouterr().out
    assert printed.count("| 20, ") == len(coverage.KINDS)
    assert "of 6 pairs" in printed


def test_a_picture_is_repeated_until_a_size_is_full() -> None:
    picture = Image.fromarray(np.arange(24, dtype=np.uint8).reshape(2, 4, 3))
    pixels = np.asarray(serving.tiled(picture, (6, 5)))
    assert pixels.shape == (5, 6, 3)
    assert (pixels[4, 5] == np.asarray(picture)[0, 1]).all()


@pytest.mark.slow
def test_the_server_answers_what_it_takes_and_refuses_the_rest(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "LARGE_PX", (400, 300))
    assert serving.main([str(FILE)]) == 0
    told = [line.split(" | ") for line in capsys.readouterr().out.splitlines()[1:]]
    assert [answers for _, answers, *_ in told[:3]] == ["1 × 200", "128 × 200", "8 × 413"]
    assert [answers for _, answers, *_ in told[4:]] == ["1 × 200", "1 × 200"]
    memory = [float(greatest) for _, _, greatest, _ in told]
    assert memory == sorted(memory)
