"""What the library calls a parameter, a user reads as the option that gives it."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_group

from pavetwin.cli import COMMANDS, app
from pavetwin.cli.flags import FLAGS, with_flags


@pytest.mark.parametrize(
    ("message", "typed", "read"),
    [
        ("`altitude_m` 2: too low.", "fly town", "--altitude 2: too low."),
        (
            "`count` 99: only 8; `count=None` inspects them all.",
            "fly town",
            "--segments 99: only 8; --segments all inspects them all.",
        ),
        ("`count` 0: at least one.", "capture show d", "--count 0: at least one."),
        ("with `picture=png`, not with `picture=jpg`", "capture town", "with --png, not with no --png"),
        ("it exists (`force`)", "world build town.osm", "it exists (--force)"),
        ("it exists (`force`)", "world show town", "it exists (`force`)"),
        ("`plugins`: no file", "policy check hover", "--plugin: no file"),
        ("`policy`: no policy", "policy check hover", "`policy`: no policy"),
        ("`order` up", "fly town", "--order up"),
        (
            "run `pavetwin world build SOURCE output=my/town force`",
            "fly my/town",
            "run `pavetwin world build SOURCE --output my/town --force`",
        ),
        ("`pavetwin capture WORLD images=3`", "fly", "`pavetwin capture WORLD --images 3`"),
        ("save it with `save_world` first", "fly town", "save it with `save_world` first"),
    ],
)
def test_parameters_become_options_of_the_typed_command(message: str, typed: str, read: str) -> None:
    assert with_flags(message, typed.split(), get_group(app)) == read


def commands() -> Iterator[Any]:
    group: Any = get_group(app)
    left = [group.get_command(None, name) for name in COMMANDS]
    while left:
        command = left.pop()
        left += getattr(command, "commands", {}).values()
        yield command


def test_every_option_named_there_is_one() -> None:
    known = {flag for command in commands() for parameter in command.params for flag in parameter.opts}
    named = {flag for text in FLAGS.values() for flag in text.split() if flag.startswith("--")}
    assert sorted(named - known) == []


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("policy", "check", "hovr"), "Error: policy check: no policy 'hovr' (did you mean 'hover'?);"),
        (("sensor", "check", "idael"), "Error: sensor check: no sensor 'idael' (did you mean 'ideal'?);"),
        (("policy", "check", "mine.py"), "Error: policy check: 'mine.py' lacks the name of the class;"),
        (("policy", "check", "hover", "--plugin", "gone.py"), "Error: --plugin: there is no file '"),
        (("fly", "no/town"), "make one with `pavetwin world build SOURCE --output no/town`."),
        (("experiment", "run", "d.yaml", "-o", "s"), "Error: the design: plugins: there is no file '"),
        (("experiment", "run", "plain.yaml", "-o", "s", "--plugin", "gone.py"), "Error: --plugin: there is no file '"),
        (("experiment", "report", "s"), "make one with `pavetwin experiment run DESIGN.yaml --output s`."),
    ],
)
def test_a_typed_command_is_answered_in_its_own_words(tmp_path: Path, arguments: tuple[str, ...], line: str) -> None:
    from pavetwin.world.store import save_world
    from scenes import built

    if "run" in arguments:
        save_world(built("cross"), tmp_path / "town")
        (tmp_path / "d.yaml").write_text("worlds: [town]\nplugins: [gone.py]\n")
        (tmp_path / "plain.yaml").write_text("worlds: [town]\n")
    done = subprocess.run(
        [sys.executable, "-c", "from pavetwin.cli import main; main()", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert done.returncode == 2, done.stderr
    assert line in done.stderr
    assert done.stderr.count("\n") == 1
