"""Options from memory, numbers with a unit and misspelt files are told what was meant."""

from pathlib import Path

import pytest

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.world.network import source_kind
from scenes.command_line import pavetwin, plain_refusal


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
