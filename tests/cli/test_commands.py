"""Help texts, hints for mistyped options, one-line errors, and the modules that a command loads."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.errors import StyleSyntaxError
from rich.style import Style
from typer.main import get_group

from pavetwin.cli import COMMANDS, app
from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.world.network import source_kind
from scenes.command_line import pavetwin, plain_refusal

TAG = re.compile(r"(\\*)\[([a-z#/@][^\[]*?)\]")
"""What `rich.markup` takes for a tag; after an odd number of backslashes it is text."""


def help_texts() -> Iterator[tuple[str, str]]:
    """Every command with its help, and with that of each of its parameters."""
    group: Any = get_group(app)
    left = [(name, group.get_command(None, name)) for name in COMMANDS]
    while left:
        path, command = left.pop()
        left += [(f"{path} {name}", each) for name, each in getattr(command, "commands", {}).items()]
        reported = [
            command.help,
            command.short_help,
            command.epilog,
            *(getattr(each, "help", "") for each in command.params),
        ]
        yield from ((path, text) for text in reported if text)


def hidden_words(text: str) -> list[str]:
    """What is in square brackets and is no style."""
    found = []
    for slashes, tag in TAG.findall(text):
        try:
            Style.parse(tag.removeprefix("/"))
        except StyleSyntaxError:
            if len(slashes) % 2 == 0:
                found.append(tag)
    return found


def test_no_help_text_hides_words_in_square_brackets() -> None:
    texts = list(help_texts())
    assert len({path for path, _ in texts}) > 40
    assert {path: hidden_words(text) for path, text in texts if hidden_words(text)} == {}
    assert hidden_words("[bold]export[/]: [coco], \\[yolo], [1.5, 12]") == ["coco"]


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        ("data build", ("export: [yolo, coco]", "platforms: [uav]", "gsd_mm: [1.5, 12]")),
        ("train", ("pip install pavetwin[train]",)),
    ],
)
def test_the_terminal_shows_words_in_square_brackets(command: str, shown: tuple[str, ...]) -> None:
    text = pavetwin(*command.split(), "--help").stdout
    assert [each for each in shown if each not in text] == []


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        (("--drone", "mavic3e"), "No such option: --drone (did you mean --aircraft?)"),
        (("--uav", "mavic3e"), "(did you mean --aircraft?)"),
        (("--height", "10"), "(did you mean --altitude?)"),
        (("--battery", "77"), "energy.reserve"),
        (("--altitude", "10m"), "--altitude: give a number of metres, such as 10, without a unit."),
    ],
)
def test_the_right_name_of_an_unknown_option_is_suggested(typed: tuple[str, ...], words: str) -> None:
    done = pavetwin("fly", "nowhere", *typed)
    assert words in plain_refusal(done)


def test_a_command_without_the_option_gets_no_hint_of_it() -> None:
    assert "did you mean" not in plain_refusal(pavetwin("doctor", "--drone", "x"))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("battery.capacity_j=3", "'battery' (did you mean 'energy'?)"),
        ("height=3", "'height' (did you mean 'altitude_m'?)"),
    ],
)
def test_the_right_name_of_an_unknown_setting_is_suggested(override: str, words: str) -> None:
    with pytest.raises(PaveTwinError) as caught:
        load_settings(overrides=[override])
    assert words in str(caught.value)


def test_a_question_mark_lists_the_cameras() -> None:
    done = pavetwin("fly", "--set", "camera.model=?", "--settings")
    assert "known are" in plain_refusal(done)


def test_a_file_with_a_name_like_that_of_a_missing_map_is_suggested(tmp_path: Path) -> None:
    (tmp_path / "berlin_neukoelln.osm").touch()
    (tmp_path / "berlin_neukolln.txt").touch()
    with pytest.raises(PaveTwinError, match=r"did you mean 'berlin_neukoelln.osm'"):
        source_kind(tmp_path / "berlin_neukolln.osm")


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
    *reported, last = ran.stderr.splitlines()
    ended, *loaded = last.split()
    assert int(ended) == code, ran.stderr
    assert "pavetwin" in loaded
    assert sorted(unwanted & set(loaded)) == []
    assert reported == [] if code == 0 else reported[0].startswith("Error: ")


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
    imported, *reported, loaded = ran.stdout.splitlines()
    assert reported == ["[True] True True", "True"]
    assert {"pandas", "scipy"} & set(imported.split()) == set()
    assert "pandas" not in loaded.split()


@pytest.mark.parametrize(("word", "meant"), [("flyy", "'fly'"), ("experimnt", "'experiment'")])
def test_the_nearest_command_is_suggested(
    word: str, meant: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from pavetwin.cli import main

    monkeypatch.setattr(sys, "argv", ["pavetwin", word])
    with pytest.raises(SystemExit):
        main()
    assert f"Did you mean {meant}" in capsys.readouterr().err
