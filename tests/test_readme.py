"""Every command of the README, shortened, over towns with street names in four scripts, prints no library messages."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from pavetwin.experiments.design import preset_text
from scenes import scripts
from scenes.command_line import pavetwin_process

ROOT = Path(__file__).resolve().parent.parent
SHORTER = {
    "--density high": "--density low",
    "--segments 8": "--segments 2",
    "--images 500": "--images 2",
}
"""Options of the README with their replacements in a test."""

PROGRESS = re.compile(r".* …|.* \(\d+%\)")


def readme_commands() -> list[str]:
    """Commands of the code blocks, in order."""
    blocks = re.findall(r"^```\w*\n(.*?)^```", (ROOT / "README.md").read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.startswith("pavetwin ")]


def without_progress(printed: str) -> list[str]:
    return [line for line in printed.splitlines() if not PROGRESS.fullmatch(line)]


def shortened(design: Path) -> None:
    values = yaml.safe_load(design.read_text("utf-8"))
    values |= {
        "densities": values["densities"][-1:],
        "altitudes_m": [10],
        "policies": ["baseline", "skip"],
        "replicates": 1,
    }
    design.write_text(yaml.safe_dump(values), "utf-8")


def run_all(folder: Path, script: str, commands: list[str]) -> None:
    town = scripts.TOWNS[script]
    (folder / "my-town.osm").write_text(scripts.extract(town), encoding="utf-8")
    for typed in commands:
        for long, short in SHORTER.items():
            typed = typed.replace(long, short)
        words = shlex.split(typed)[1:]
        if words[:2] == ["world", "build"]:
            words += ["--defects-per-segment", "4"] + ["--left-hand"] * town.left_hand
        done = pavetwin_process(*words, cwd=folder)
        assert done.returncode == 0, f"{typed}: {done.stderr}"
        assert without_progress(done.stderr) == [], typed
        assert not re.search(r"Warning|Glyph|font_manager", done.stdout), typed
        if words[1] == "init":
            shortened(folder / words[2])


@pytest.mark.parametrize("page", ["README.md", "docs/how-to/study.md", "src/pavetwin/cli/experiment.py"])
def test_recommended_traffic_is_in_the_initial_design(page: str) -> None:
    """`recommend studies/first --traffic NAME` names traffic that `experiment init` writes."""
    named = re.findall(r"recommend studies/first .*?--traffic (\S+)", (ROOT / page).read_text("utf-8"))
    written = yaml.safe_load(preset_text("default", "worlds/my-town"))
    assert named
    assert set(named) <= set(written["densities"])


@pytest.mark.slow
@pytest.mark.needs_adapter
def test_the_readmes_commands_print_no_library_messages(tmp_path: Path) -> None:
    commands = readme_commands()
    assert {shlex.split(typed)[1] for typed in commands} == {"world", "fly", "experiment", "capture"}
    more = ["pavetwin experiment report studies/first", "pavetwin world show worlds/my-town --ids --html"]
    more += ["pavetwin world navmesh worlds/my-town", "pavetwin capture show datasets/my-town"]
    run_all(tmp_path, "chinese", [*commands, *more])


@pytest.mark.slow
@pytest.mark.parametrize("script", ["arabic", "cyrillic", "devanagari"])
def test_towns_in_other_scripts_print_no_library_messages(script: str, tmp_path: Path) -> None:
    commands = [typed for typed in readme_commands() if typed.split()[1] in ("world", "fly")]
    run_all(tmp_path, script, [*commands, "pavetwin world show worlds/my-town --ids --html"])
