"""What a command loads before it can answer: a mistake, a version or a help text waits for nothing heavy."""

import subprocess
import sys
from pathlib import Path

import pytest

SLOW_TO_LOAD = {
    *("numpy", "scipy", "shapely", "pyproj", "pyogrio", "polars", "pyarrow", "duckdb", "pandas", "statsmodels"),
    *("matplotlib", "PIL", "wgpu", "jinja2", "distributed", "libsumo", "traci", "sumolib", "osmium", "tornado"),
}
PRINTING = {"rich"}
NEEDED_BY_POLICIES = {"numpy", "shapely", "pyproj"}
"""A help text that lists the registered policies and sensors has to load them."""

RUN = """
import sys
from pavetwin.cli import main
try:
    main()
except SystemExit as ended:
    print(ended.code, *sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("words", "code", "unwanted"),
    [
        (["--version"], 0, SLOW_TO_LOAD | PRINTING | {"pydantic"}),
        (["fly", "nosuch"], 2, SLOW_TO_LOAD | PRINTING),
        (["fly", "nosuch", "--policy", "all", "--save-frames", "hits"], 2, SLOW_TO_LOAD | PRINTING),
        (["capture", "nosuch", "-o", "dataset"], 2, SLOW_TO_LOAD | PRINTING),
        (["world", "info", "nosuch"], 2, SLOW_TO_LOAD | PRINTING),
        (["world", "export", "nosuch", "-o", "town.glb"], 2, SLOW_TO_LOAD | PRINTING),
        (["traffic", "record", "nosuch", "--density", "high"], 2, SLOW_TO_LOAD | PRINTING),
        (["app", "nosuch"], 2, SLOW_TO_LOAD - {"tornado"} | PRINTING),
        (["flyy"], 2, SLOW_TO_LOAD | PRINTING),
        (["--help"], 0, SLOW_TO_LOAD),
        (["fly", "--help"], 0, SLOW_TO_LOAD - NEEDED_BY_POLICIES),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_quick_answer_loads_nothing_heavy(words: list[str], code: int, unwanted: set[str], tmp_path: Path) -> None:
    ran = subprocess.run([sys.executable, "-c", RUN, *words], cwd=tmp_path, capture_output=True, text=True, check=False)
    *told, last = ran.stderr.splitlines()
    ended, *loaded = last.split()
    assert int(ended) == code, ran.stderr
    assert "pavetwin" in loaded
    assert sorted(unwanted & set(loaded)) == []
    assert told == [] if code == 0 else told[0].startswith("Error: ")


WHAT_MISSIONS_COMPUTE = """
import sys
import numpy as np
import pavetwin.cli.flight_report, pavetwin.draw.mission_map, pavetwin.mission
from pavetwin.defects.severity import Distress
from pavetwin.mission.metrics import found_share
from pavetwin.pci.curves import deduct_value
from pavetwin.traffic.tracks import PackedPart
from pavetwin.traffic.tracks import PoseRows
from pavetwin.traffic.tracks import TrackPart
from pavetwin.uav import find_aircraft
from pavetwin.uav.energy import rotor_power
from pavetwin.world.model import Severity

print(*sorted({name.partition(".")[0] for name in sys.modules}))
one = np.ones(1, np.float32)
rows = PoseRows(np.array([0, 1], np.uint32), np.zeros(1, np.uint32), one, one, one, one)
part = PackedPart.of(TrackPart.of(rows, 0)).load()
share = found_share([3, 2], [9, 8])
print(part.is_last.tolist(), 0 < share.low < share.high < 1, rotor_power(find_aircraft("mavic3e")).total_w.min() > 50)
print(deduct_value(Distress.POTHOLES, Severity.HIGH, 0.1) > 0)
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""


def test_a_recorded_mission_needs_no_pandas_and_begins_without_scipy() -> None:
    """A third of a second each, in every process of a study and before the first table."""
    ran = subprocess.run([sys.executable, "-c", WHAT_MISSIONS_COMPUTE], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    imported, *told, loaded = ran.stdout.splitlines()
    assert told == ["[True] True True", "True"]
    assert {"pandas", "scipy"} & set(imported.split()) == set()
    assert "pandas" not in loaded.split()


@pytest.mark.parametrize(("word", "meant"), [("flyy", "'fly'"), ("experimnt", "'experiment'")])
def test_a_misspelt_command_is_told_the_nearest(
    word: str, meant: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pavetwin.cli import main

    monkeypatch.setattr(sys, "argv", ["pavetwin", word])
    with pytest.raises(SystemExit):
        main()
    assert f"Did you mean {meant}" in capsys.readouterr().err
