"""What the library calls a parameter, a user reads as the option that gives it."""

import pytest
import typer

from pavetwin.cli import COMMANDS, app
from pavetwin.cli.flags import FLAGS, OF_COMMAND, with_flags


@pytest.mark.parametrize(
    ("message", "command", "read"),
    [
        ("`altitude_m` 2: too low.", "fly", "--altitude 2: too low."),
        (
            "`count` 99: only 8; `count=None` inspects these.",
            "fly",
            "--segments 99: only 8; --segments all inspects these.",
        ),
        ("`count` 0: at least one.", "capture", "--count 0: at least one."),
        ("with `picture=png`, not with `picture=jpg`", "capture", "with --png, not with no --png"),
        (
            "run `pavetwin world build SOURCE -o town` and `force`",
            "fly",
            "run `pavetwin world build SOURCE -o town` and --force",
        ),
        ("save it with `save_world` first", "fly", "save it with `save_world` first"),
    ],
)
def test_parameters_become_options(message: str, command: str, read: str) -> None:
    assert with_flags(message, command) == read


def test_every_option_named_there_is_one() -> None:
    group = typer.main.get_group(app)
    known = set()
    commands = [group.get_command(None, name) for name in COMMANDS]
    while commands:
        command = commands.pop()
        commands += getattr(command, "commands", {}).values()
        known |= {flag for parameter in command.params for flag in parameter.opts}
    named = {flag for text in [*FLAGS.values(), *OF_COMMAND.values()] for flag in text.split() if flag.startswith("--")}
    assert sorted(named - known) == []
