"""Commands say when the preset `paper` is not the published setup, for the world's parking lanes or its defects."""

from pathlib import Path

import pytest
import yaml

from pavetwin.cli.published import note_difference
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.world.store import load_world, save_world
from scenes import built
from scenes.command_line import pavetwin

BUILD = "pavetwin world build … --parking-rule none"
WITH, WITHOUT = "europe", "none"


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a world of each parking rule, named as the rule."""
    folder = tmp_path_factory.mktemp("published")
    for rule in (WITH, WITHOUT):
        made = add_defects(built("cross", parking_rule=rule), DefectOptions(population="paper", per_segment=2))
        save_world(made, folder / rule)
    return folder


@pytest.mark.parametrize(
    ("rule", "preset", "is_told"), [(WITH, "paper", True), (WITHOUT, "paper", False), (WITH, "default", False)]
)
def test_parking_lanes_are_told_of_once_with_the_preset_paper(
    place: Path, tmp_path: Path, rule: str, preset: str, is_told: bool
) -> None:
    def notice(*arguments: object) -> list[str]:
        done = pavetwin(*arguments)
        assert done.returncode == 0, done.stderr
        return [line for line in (done.stdout + done.stderr).splitlines() if BUILD in line]

    design = tmp_path / "study.yaml"
    said = [notice("experiment", "init", design, "--world", place / rule, "--preset", preset)]
    values = yaml.safe_load(design.read_text())
    values |= {"densities": ["low"], "altitudes_m": [10], "policies": ["baseline"], "replicates": 1, "segments": 1}
    design.write_text(yaml.safe_dump(values))
    said.append(notice("experiment", "run", design, "-o", tmp_path / "study", "--jobs", "1"))
    short = ("--density", "low", "--segments", "1", "-o", tmp_path / "mission")
    said.append(notice("fly", place / rule, *short, "--preset", preset))
    assert [len(lines) for lines in said] == [int(is_told)] * 3
    assert all("parking lanes" in line and "wider" in line for (line,) in filter(None, said))


@pytest.mark.parametrize(("placed_by", "told"), [("survey", "damage population in other (survey)"), ("paper", "")])
def test_other_defects_than_the_papers_are_told_of(
    tmp_path: Path, placed_by: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = DefectOptions(population=placed_by, per_segment=1)
    save_world(add_defects(built("cross", parking_rule="none"), options), tmp_path / "other")
    for world in (tmp_path / "other", load_world(tmp_path / "other")):
        note_difference(["paper"], [world])
        said = capsys.readouterr().out
        assert told in said
        assert ("--damage paper" in said) == bool(told)
    note_difference(["paper"], [tmp_path / "other"], "paper")
    note_difference(["default"], [tmp_path / "other"])
    assert capsys.readouterr().out == ""
