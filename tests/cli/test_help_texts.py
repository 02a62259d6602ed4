"""Help texts are Rich markup, in which a word in square brackets is a style and is not shown."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from rich.errors import StyleSyntaxError
from rich.style import Style
from typer.main import get_group

from pavetwin.cli import COMMANDS, app
from scenes.command_line import pavetwin

TAG = re.compile(r"(\\*)\[([a-z#/@][^\[]*?)\]")
"""What `rich.markup` takes for a tag; after an odd number of backslashes it is text."""


def help_texts() -> Iterator[tuple[str, str]]:
    """Every command with its help, and with that of each of its parameters."""
    group: Any = get_group(app)
    left = [(name, group.get_command(None, name)) for name in COMMANDS]
    while left:
        path, command = left.pop()
        left += [(f"{path} {name}", each) for name, each in getattr(command, "commands", {}).items()]
        told = [
            command.help,
            command.short_help,
            command.epilog,
            *(getattr(each, "help", "") for each in command.params),
        ]
        yield from ((path, text) for text in told if text)


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
def test_the_terminal_shows_them(command: str, shown: tuple[str, ...]) -> None:
    text = pavetwin(*command.split(), "--help").stdout
    assert [each for each in shown if each not in text] == []
