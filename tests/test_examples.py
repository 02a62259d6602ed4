"""The examples and the documentation's code run as they stand."""

import re
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from pavetwin.config.mission import PolicySettings
from pavetwin.defects import DefectOptions, add_defects
from pavetwin.policies import load_policy
from pavetwin.policies.conformance import check_policy
from pavetwin.world.store import save_world
from scenes import built

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, example, tmp_path], capture_output=True, text=True, check=False, cwd=tmp_path, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "coverage=" in done.stdout
    assert pl.read_parquet(tmp_path / "mission" / "mission.parquet").height == 8


def test_the_first_example_is_ten_lines() -> None:
    lines = EXAMPLES[0].read_text(encoding="utf-8").splitlines()
    statements = [line for line in lines if line and not line.startswith(("import ", "from ", '"""'))]
    assert len(statements) <= 10


def code_blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_documented_policy_is_short_and_sound(tmp_path: Path) -> None:
    (code,) = code_blocks("docs/adding-a-policy.md", "python")
    assert len(code.splitlines()) < 30
    file = tmp_path / "patient.py"
    file.write_text(code, encoding="utf-8")
    policy = load_policy(f"{file}:Patient", PolicySettings())
    assert check_policy(type(policy)) == []


def test_the_readmes_code_runs(tmp_path: Path) -> None:
    (snippet,) = code_blocks("README.md", "python")
    save_world(add_defects(built("cross"), DefectOptions(per_segment=8)), tmp_path / "worlds" / "my-town")
    done = subprocess.run(
        [sys.executable, "-c", snippet], capture_output=True, text=True, check=False, cwd=tmp_path, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert "coverage=" in done.stdout


def test_the_readme_names_only_what_there_is() -> None:
    (snippet,) = code_blocks("README.md", "python")
    import pavetwin

    used = set(re.findall(r"\bpt\.(\w+)", snippet))
    assert used <= set(pavetwin.__all__)
    for page in re.findall(r"\]\(([\w/.-]+\.(?:md|png|svg))\)", (ROOT / "README.md").read_text(encoding="utf-8")):
        assert (ROOT / page).is_file(), page
