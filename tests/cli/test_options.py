"""Options: groups, conditions, their names in errors, and values that do not fit."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, get_args

import pytest
import typer
import yaml
from PIL import Image
from typer.main import get_group

from pavetwin.cli import COMMANDS, app
from pavetwin.cli.commands import in_options
from pavetwin.cli.options import grouped
from scenes.command_line import pavetwin, plain_refusal


@pytest.mark.parametrize(
    ("message", "typed", "expected"),
    [
        ("`altitude_m` 2: too low.", "fly", "--altitude 2: too low."),
        ("`count` 99: only 8.", "fly", "--segments 99: only 8."),
        ("`count` 0: at least one.", "capture show", "--count 0: at least one."),
        ("it exists (`force`)", "world build", "it exists (--force)"),
        ("it exists (`force`)", "world show", "it exists (`force`)"),
        ("`plugins`: no file", "policy check", "--plugin: no file"),
        ("`policy`: no policy", "policy check", "`policy`: no policy"),
        ("run `pavetwin world build SOURCE -o town`", "fly", "run `pavetwin world build SOURCE -o town`"),
    ],
)
def test_parameters_become_options_of_the_command(message: str, typed: str, expected: str) -> None:
    command: Any = get_group(app)
    for word in typed.split():
        command = command.get_command(None, word)
    assert in_options(message, command) == expected


@dataclass(frozen=True)
class Speed:
    """Speed."""

    speed_mps: Annotated[float, typer.Option("--speed", help="In m/s.")] = 5.0
    names: Annotated[list[str] | None, typer.Option("--name")] = None


def test_a_group_is_spread_into_options_and_handed_back() -> None:
    got = []
    made = typer.Typer()

    @made.command()
    @grouped
    def move(speed: Speed, place: str, is_fast: bool = False) -> None:
        got.append((speed, place, is_fast))

    for words in (["here"], ["here", "--speed", "3", "--name", "a", "--name", "b", "--is-fast"]):
        made(words, standalone_mode=False)
    assert got == [(Speed(), "here", False), (Speed(3.0, ["a", "b"]), "here", True)]


def test_two_groups_with_one_option_are_refused() -> None:
    def move(speed: Speed, other: Speed) -> None: ...

    with pytest.raises(ValueError, match="duplicate parameter name"):
        grouped(move)


USUAL: dict[str, tuple[str, ...]] = {
    "inventory": ("photographs",),
    "world build": ("-o", "new"),
    "world build --anchor": ("-o", "new", "--generate", "grid"),
    "world build --damage": ("-o", "new", "--generate", "grid"),
    "world build --defect-mix": ("-o", "new", "--generate", "grid"),
    "world build --parking-rule": ("-o", "new", "--generate", "grid"),
    "world navmesh": ("town",),
    "world export": ("town", "new.glb"),
    "traffic record": ("town",),
    "fly": ("town", "-o", "new"),
    "capture make": ("town", "-o", "new"),
    "evaluate": ("new.json", "town", "-o", "new"),
    "data composite --shares": ("town", "-o", "new", "--roads", "uapd"),
    "data import": ("uav-cars", "town", "-o", "new"),
    "data pack": ("roads", "-o", "new"),
    "detect": ("town", "-o", "new"),
    "sensor fit": ("town", "-o", "new.json"),
    "serve": ("--port", "0"),
    "train": ("roads", "-o", "new"),
    "experiment init": ("new.yaml",),
    "experiment run": ("plain.yaml", "-o", "new"),
}
"""Further arguments, by command, or by command and option."""

NEEDS_RESULTS = {
    "capture show --split",
    "data composite --objects",
    "data composite --road-masks",
    "data composite --roads",
    "data export --formats",
    "evaluate --against",
    "evaluate --regions",
    "evaluate --run",
    "experiment recommend --traffic",
    "experiment recommend --world",
    "export --int8",
    "export --licence",
    "serve --host",
    "train --device",
}
"""Options of commands that read a dataset or a study; tested with those commands."""

NEW = {"--output", "--geopackage", "--cache"}
"""Options that name a file or folder to be written."""

LATER = {"experiment init --world", "experiment init --plugin"}
"""Options that may name files of later."""


def options_with_texts() -> Iterator[tuple[str, str]]:
    """Every option that takes a name or a file: command and option."""
    group: Any = get_group(app)
    left = [(name, group.get_command(None, name)) for name in COMMANDS]
    while left:
        path, command = left.pop()
        left += [(f"{path} {name}", each) for name, each in getattr(command, "commands", {}).items()]
        for each in command.params if not hasattr(command, "commands") else ():
            flag = max(each.opts, key=len)
            of = each.type_descriptor.annotation
            if flag.startswith("-") and {str, Path}.intersection(get_args(of) or (of,)):
                yield path, flag


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from pavetwin.world.store import save_world
    from scenes import built

    folder = tmp_path_factory.mktemp("flags")
    save_world(built("cross"), folder / "town")
    (folder / "photographs").mkdir()
    Image.new("RGB", (64, 64)).save(folder / "photographs" / "a.png")
    (folder / "plain.yaml").write_text("worlds: [town]\n")
    (folder / "d.yaml").write_text("worlds: [town]\nplugins: [gone.py]\n")
    return folder


@pytest.mark.parametrize(
    ("path", "flag"),
    [
        (path, flag)
        for path, flag in sorted(options_with_texts())
        if f"{path} {flag}" not in NEEDS_RESULTS | LATER and flag not in NEW
    ],
)
def test_a_wrong_name_or_file_is_refused_by_its_option(place: Path, path: str, flag: str) -> None:
    before = sorted(place.iterdir())
    usual = USUAL.get(f"{path} {flag}") or USUAL.get(path) or ("town",)
    line = plain_refusal(pavetwin(*path.split(), *usual, flag, "nosuch", cwd=place))
    assert line.startswith(f"Error: {flag}"), line
    assert "nosuch" in line or flag == "--scheduler", line
    assert sorted(place.iterdir()) == before


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ("fly", "town", "--preset", "papr"),
            "--preset: no preset 'papr' (did you mean 'paper'?); known are default, ",
        ),
        (("experiment", "init", "n.yaml", "--preset", "papr"), "--preset: no design 'papr' (did you mean 'paper'?)"),
        (("fly", "town", "--density", "hihg"), "--density: no density 'hihg' (did you mean 'high'?); known are low, "),
        (("capture", "town", "-o", "n", "--camera", "phantom"), "--camera: no camera 'phantom' (did you mean 'phantom"),
        (("fly", "town", "--set", "camera.model=phantom"), "camera.model: no camera 'phantom' (did you mean 'phantom"),
        (("fly", "town", "--clouds", "2"), "--clouds: it must be less than or equal to 1 (got 2)."),
        (
            ("fly", "town", "--set", "conditions.clouds=5"),
            "settings (preset 'default'): conditions.clouds: it must be less than or equal to 1 (got 5).",
        ),
    ],
)
def test_names_and_values_are_refused_in_one_form(place: Path, arguments: tuple[str, ...], line: str) -> None:
    assert plain_refusal(pavetwin(*arguments, cwd=place)).startswith(f"Error: {line}")


@pytest.mark.parametrize(
    ("arguments", "module", "registry"),
    [
        (("capture", "make"), "pavetwin.capture.platforms", "PLATFORMS"),
        (("capture", "make"), "pavetwin.capture.formats", "FORMATS"),
        (("capture", "make"), "pavetwin.uav", "CAMERAS"),
        (("data", "import"), "pavetwin.training.datasets.sources", "SOURCES"),
        (("fly",), "pavetwin.policies", "POLICIES"),
        (("fly",), "pavetwin.sensing", "SENSORS"),
    ],
)
def test_help_lists_what_is_registered(arguments: tuple[str, ...], module: str, registry: str) -> None:
    names = getattr(import_module(module), registry)
    names.add("of-my-own", SimpleNamespace())
    try:
        reported = pavetwin(*arguments, "--help", columns=400).stdout
    finally:
        names.restore("of-my-own", None)
    assert ", ".join([*names.names(), "of-my-own"]) in reported


GRID = ("world", "build", "--generate", "grid", "-o", "worlds/grid")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("policy", "check", "hovr"), "Error: policy check: no policy 'hovr' (did you mean 'hover'?);"),
        (("sensor", "check", "idael"), "Error: sensor check: no sensor 'idael' (did you mean 'ideal'?);"),
        (("policy", "check", "mine.py"), "Error: policy check: 'mine.py' names no class;"),
        (("defect", "check", "potole"), "Error: defect check: no defect class 'potole' (did you mean 'pothole'?);"),
        (("defect", "check", "potole"), "Name a class of your own by its file, as in my_class.py:ravelling."),
        ((*GRID, "--segment-length", "-5"), "Error: --segment-length: it must be greater than or equal to 40"),
        ((*GRID, "--defects-per-100-m2", "-1"), "Error: --defects-per-100-m2: it must be greater than or equal to 0"),
        ((*GRID, "--defect-mix", "hole=3"), "Error: --defect-mix: no defect class 'hole' (did you mean 'pothole'?);"),
        (("serve", "--port", "99999"), "Error: --port: it must be less than or equal to 65535."),
        (("policy", "check", "hover", "--plugin", "gone.py"), "Error: --plugin: there is no file '"),
        (("fly", "no/town"), "make one with `pavetwin world build SOURCE --output no/town`."),
        (("experiment", "run", "d.yaml", "-o", "s"), "Error: the design 'd.yaml': plugins: there is no file '"),
        (("experiment", "run", "plain.yaml", "-o", "s", "--plugin", "gone.py"), "Error: --plugin: there is no file '"),
        (("experiment", "report", "s"), "make one with `pavetwin experiment run DESIGN.yaml --output s`."),
    ],
)
def test_errors_name_what_was_typed(place: Path, arguments: tuple[str, ...], line: str) -> None:
    assert line in plain_refusal(pavetwin(*arguments, cwd=place))


@pytest.mark.parametrize(
    ("wind", "mps", "from_deg"), [("5@90", 5.0, 90.0), ("5", 5.0, 270.0), ("2.5@0", 2.5, 0.0), ("0", 0.0, 270.0)]
)
def test_the_options_become_conditions(wind: str, mps: float, from_deg: float) -> None:
    options = ("--date", "2026-06-21", "--time", "10:30", "--clouds", "0.4", "--wind", wind)
    settings = yaml.safe_load(pavetwin("fly", *options, "--settings").stdout)
    expected = {"date": "2026-06-21", "time": "10:30:00", "clouds": 0.4, "wind_mps": mps, "wind_from_deg": from_deg}
    assert settings["conditions"] == {**expected, "gust_factor": 1.0, "temperature_c": 20.0, "turbidity": 3.0}


def test_conditions_that_are_not_given_are_those_of_the_preset() -> None:
    settings = yaml.safe_load(pavetwin("fly", "--wind", "5", "--settings").stdout)
    assert settings["conditions"]["clouds"] == 0.1


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--date", "2026-02-30"), "--date: expected a date of the calendar, such as 2026-06-21"),
        (("--date", "1066-10-14"), "--date: expected a date from 1950 to 2050"),
        (("--time", "25:00"), "--time: expected a time of day without a time zone, such as 09:30"),
        (("--clouds", "40"), "--clouds: it must be less than or equal to 1 (got 40)"),
        (("--wind", "5@400"), "--wind: it must be less than 360"),
        (("--wind", "west"), "--wind: expected metres per second, optionally with the direction it comes from"),
        (("--wind=-5",), "--wind: expected metres per second"),
        (("--parking", "1.5"), "--parking: expected a share of the places (0 to 1)"),
        (("--parking", "few"), "--parking: expected a share of the places (0 to 1)"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_option(options: tuple[str, ...], line: str) -> None:
    assert plain_refusal(pavetwin("fly", *options, "--settings")).startswith(f"Error: {line}")


@pytest.mark.parametrize(
    ("options", "enabled", "occupancy"),
    [
        ((), True, None),
        (("--parking", "by-time"), True, None),
        (("--preset", "paper"), False, None),
        (("--parking", "none"), False, None),
        (("--preset", "paper", "--parking", "0.9"), True, 0.9),
    ],
)
def test_vehicles_park_unless_that_is_turned_off(
    options: tuple[str, ...], enabled: bool, occupancy: float | None
) -> None:
    settings = yaml.safe_load(pavetwin("fly", *options, "--settings").stdout)
    assert settings["parking"] == {"enabled": enabled, "occupancy": occupancy}
