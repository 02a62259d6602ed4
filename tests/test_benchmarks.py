"""The benchmarks' own arithmetic, and one measurement of each kind that needs no SUMO."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from benchmarks import machine, startup, streets
from benchmarks.__main__ import main
from benchmarks.measure import Kind, Line, median_s
from benchmarks.table import as_json, notes, table
from rich.console import Console


@pytest.mark.parametrize(
    ("value", "kind", "target", "reached"),
    [
        (2.0, Kind.SECONDS, 3.0, True),
        (4.0, Kind.SECONDS, 3.0, False),
        (4000.0, Kind.REAL_TIME, 3000.0, True),
        (2000.0, Kind.REAL_TIME, 3000.0, False),
        (1.2, Kind.RATIO, 1.5, True),
        (9.0, Kind.MEBIBYTES, None, None),
    ],
)
def test_a_line_knows_whether_its_target_is_reached(
    value: float, kind: Kind, target: float | None, reached: bool | None
) -> None:
    assert Line("it", value, kind, target).reached is reached


def test_values_are_shown_with_their_unit() -> None:
    assert Kind.SECONDS.shown(2.5e-6) == "2.5 µs"
    assert Kind.SECONDS.shown(0.2165) == "216 ms"
    assert Line("it", 30312.0, Kind.REAL_TIME, 3000.0, took_s=0.009).measured() == "9 ms, 30,312 ×"
    assert Line("it", 1.0, Kind.REAL_TIME, 3000.0).asked() == "≥ 3,000 ×"


def test_the_median_leaves_the_warm_up_out() -> None:
    calls: list[int] = []
    assert median_s(lambda: calls.append(1), runs=3, warm_up=2) >= 0
    assert len(calls) == 5


def test_streets_are_measured_and_tabled() -> None:
    measured = list(streets.lines(quick=True))
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
    assert [line.what for line in lines] == ["pavetwin --version", "pavetwin fly, a misspelt world", "import pavetwin"]
    assert all(line.value > 0 for line in lines)
    assert [line.target for line in lines] == [0.2, 0.5, None]


def test_a_world_that_is_not_there_is_one_plain_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--quick", "--world", str(tmp_path / "nowhere"), "--json", str(tmp_path / "out.json")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out.json").exists()
