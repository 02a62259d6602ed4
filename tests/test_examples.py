"""The examples and the documentation's code run as they stand."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from pavetwin.world.store import save_world
from scenes import damaged

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
LONGEST = 60

SAYS = {
    "01_first_flight": "coverage=",
    "02_own_policy": "patient: coverage=",
    "03_own_defect_class": "rutting",
    "04_own_demand": r"hover: .* [1-9]\d* s waited",
    "05_study": "hover",
    "06_dataset": "6 images in",
    "07_python_loop": "found",
    "08_own_agent": r"found [1-9]\d* of",
}
"""Regular expression for the output of each example."""

DRAWS = {"06_dataset"}


def marked(example: Path) -> object:
    marks = [pytest.mark.slow, *[pytest.mark.needs_adapter] * (example.stem in DRAWS)]
    return pytest.param(example, marks=marks, id=example.stem)


def run(arguments: list[str], folder: Path) -> str:
    """Output of a script."""
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=folder, timeout=500
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("example", [marked(example) for example in EXAMPLES])
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    assert re.search(SAYS[example.stem], run([str(example), str(tmp_path)], tmp_path))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short(example: Path) -> None:
    assert len(example.read_text(encoding="utf-8").splitlines()) < LONGEST


def test_the_first_example_is_ten_lines() -> None:
    lines = EXAMPLES[0].read_text(encoding="utf-8").splitlines()
    statements = [line for line in lines if line and not line.startswith(("import ", "from ", '"""'))]
    assert len(statements) <= 10


def code_blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_readmes_code_runs(tmp_path: Path) -> None:
    (snippet,) = code_blocks("README.md", "python")
    save_world(damaged("cross", 8), tmp_path / "worlds" / "my-town")
    assert "coverage=" in run(["-c", snippet], tmp_path)


def test_the_readme_names_only_what_there_is() -> None:
    (snippet,) = code_blocks("README.md", "python")
    import pavetwin

    used = set(re.findall(r"\bpt\.(\w+)", snippet))
    assert used <= set(pavetwin.__all__)


def test_the_documented_sensor_keeps_the_rules() -> None:
    from pavetwin.sensing import Sensor, check_sensor

    code, *_ = code_blocks("docs/how-to/own-sensor.md", "python")
    names: dict[str, type[Sensor]] = {"__name__": "documented"}  # type: ignore[dict-item]
    exec(code, names)
    assert check_sensor(names["ByVisibility"]) == []


def test_the_documented_plugin_registers_a_policy(tmp_path: Path) -> None:
    from pavetwin.plugins import load_plugins
    from pavetwin.policies import POLICIES

    (code,) = code_blocks("docs/how-to/plugins.md", "python")
    file = tmp_path / "my_things.py"
    file.write_text(code, encoding="utf-8")
    load_plugins([file])
    try:
        assert "carefree" in POLICIES.names()
    finally:
        POLICIES.restore("carefree", None)


def test_the_documented_entry_points_are_those_of_registries() -> None:
    named = set(re.findall(r"`(pavetwin\.\w+)`", (ROOT / "docs" / "how-to" / "plugins.md").read_text(encoding="utf-8")))
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").rglob("*.py"))
    assert named - {"pavetwin.plugins"} == set(re.findall(r'group="(pavetwin\.\w+)"', source))
