"""Help texts, hints for mistyped options, and the one line of each error."""

import re
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
def test_an_option_from_memory_is_told_its_name(typed: tuple[str, ...], words: str) -> None:
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
def test_a_setting_from_memory_is_told_its_name(override: str, words: str) -> None:
    with pytest.raises(PaveTwinError) as caught:
        load_settings(overrides=[override])
    assert words in str(caught.value)


def test_a_question_mark_lists_the_cameras() -> None:
    done = pavetwin("fly", "--set", "camera.model=?", "--settings")
    assert "known are" in plain_refusal(done)


def test_a_misspelt_map_is_told_its_neighbour(tmp_path: Path) -> None:
    (tmp_path / "berlin_neukoelln.osm").touch()
    (tmp_path / "berlin_neukolln.txt").touch()
    with pytest.raises(PaveTwinError, match=r"did you mean 'berlin_neukoelln.osm'"):
        source_kind(tmp_path / "berlin_neukolln.osm")
