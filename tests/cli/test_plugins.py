"""`--plugin`: the same flag for every command, and a defect class of one's own on the command line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import polars as pl
import pytest
from typer.main import get_group

from pavetwin import plugins
from pavetwin.cli import COMMANDS, app
from pavetwin.defects import DEFECT_CLASSES, DefectOptions, add_defects
from pavetwin.errors import PaveTwinError
from pavetwin.experiments.design import read_design
from pavetwin.policies import POLICIES
from pavetwin.world.store import save_world
from scenes import built
from scenes.command_line import pavetwin, plain_refusal

CALM = """
from pavetwin.policies import GoOn, Policy, policy
@policy("calm")
class Calm(Policy):
    def decide(self, snapshot):
        return GoOn()
"""
RUTTING = Path(__file__).resolve().parents[2] / "examples" / "rutting.py"


def leaves(command: Any, path: str) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield path, command
    else:
        for name, each in inner.items():
            yield from leaves(each, f"{path} {name}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_plugins(name: str) -> None:
    for path, command in leaves(get_group(app).get_command(None, name), name):
        flags = [flag for parameter in command.params for flag in parameter.opts]
        assert flags.count("--plugin") == 1, path


@pytest.fixture
def forgotten(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As in a process that was given no plugin, before and after the test."""
    monkeypatch.setattr(plugins, "_loaded", {})
    yield
    DEFECT_CLASSES.restore("rutting", None)


@pytest.mark.slow
@pytest.mark.usefixtures("forgotten")
def test_a_class_of_ones_own_from_the_command_line(tmp_path: Path) -> None:
    plugins.load_plugins([RUTTING])
    options = DefectOptions(population="paper", per_segment=3, mix={"rutting": 1.0})
    save_world(add_defects(built("cross"), options), tmp_path / "rutted")
    DEFECT_CLASSES.restore("rutting", None)
    plugins._loaded.clear()
    assert "rutting" in pavetwin("world", "info", tmp_path / "rutted").stdout, "looking at it needs no plugin"
    segment = built("cross").world.segments[0].id
    export = ("world", "export", tmp_path / "rutted", tmp_path / "r.glb", "--segment", segment)
    assert "needs its file in --plugin" in plain_refusal(pavetwin(*export))
    assert "there is no file" in plain_refusal(pavetwin("world", "info", tmp_path / "rutted", "--plugin", "nosuch.py"))
    fly = ("fly", tmp_path / "rutted", "--density", "low", "--segments", "1", "--plugin", RUTTING, "-o", tmp_path / "m")
    done = pavetwin(*fly)
    assert done.returncode == 0, done.stderr
    table = pl.read_csv(tmp_path / "m" / "defects.csv")
    assert table["class"].unique().to_list() == ["rutting"]
    assert table["length_m"].is_between(2.0, 6.2).all(), "its extent, as it has no cracks"
    assert table["width_m"].is_between(1.7, 2.6).all()
    assert "rutting" in DEFECT_CLASSES.names()


def test_a_design_names_the_plugins_that_it_was_written_with(tmp_path: Path) -> None:
    done = pavetwin("experiment", "init", tmp_path / "d.yaml", "--plugin", RUTTING)
    assert done.returncode == 0, done.stderr
    assert read_design(tmp_path / "d.yaml").plugins == (str(RUTTING),)
    (tmp_path / "mine.py").write_text(CALM)
    (tmp_path / "studies").mkdir()
    pavetwin("experiment", "init", "studies/m.yaml", "--plugin", "mine.py", cwd=tmp_path)
    POLICIES.restore("calm", None)
    text = (tmp_path / "studies" / "m.yaml").read_text()
    assert 'plugins: ["../mine.py"]' in text
    assert "policies: [baseline, hover, micro, skip, calm] " in text


def test_a_mix_of_classes_is_placed(tmp_path: Path) -> None:
    build = ("world", "build", "--generate", "grid", "--defects-per-segment", "2", "-o", tmp_path / "w")
    assert "did you mean 'pothole'" in plain_refusal(pavetwin(*build, "--defect-mix", "pothol=1"))
    assert "as in --defect-mix pothole=2" in plain_refusal(pavetwin(*build, "--defect-mix", "pothole"))
    options = DefectOptions(per_segment=2, mix={"pothole": 2.0})
    with patch("pavetwin.defects.placement.add_defects", side_effect=PaveTwinError("enough")) as added:
        pavetwin(*build, "--defect-mix", "pothole=2")
    assert added.call_args.args[1] == options


@pytest.mark.usefixtures("forgotten")
def test_what_a_plugin_registers_is_listed(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from pavetwin.sensing import Sensor, sensor\n"
        "@sensor('blind_one')\n"
        "class Blind(Sensor):\n"
        '    """Finds nothing."""\n'
        "    def detect(self, frame):\n"
        "        return []\n"
    )
    from pavetwin.sensing import SENSORS

    done = pavetwin("sensor", "list", "--plugin", file)
    SENSORS.restore("blind_one", None)
    assert "blind_one: Finds nothing." in done.stdout


def test_a_check_lists_every_broken_rule_of_a_policy(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "from pavetwin.policies import Policy\n"
        "class Vague(Policy):\n"
        "    def decide(self, snapshot):\n"
        "        return 3\n"
    )
    said = plain_refusal(pavetwin("policy", "check", f"{file}:Vague"))
    assert "more; --verbose lists them)" in said
    more = int(said.rpartition("(and ")[2].split()[0])
    listed = pavetwin("policy", "check", f"{file}:Vague", "--verbose")
    assert listed.returncode == 2
    assert len(listed.stdout.splitlines()) == more + 1
