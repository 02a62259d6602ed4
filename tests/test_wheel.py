"""The wheel, installed into an environment of its own outside the checkout, runs the demo."""

import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from uv import find_uv_bin

ROOT = Path(__file__).resolve().parent.parent
UNREACHABLE = ("error sending request", "dns error", "Failed to fetch", "Could not connect")
"""Messages of uv when no package index answers."""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def run(*words: str | Path, cwd: Path, timeout_s: float = 900.0) -> subprocess.CompletedProcess[str]:
    """Run a program without this process's Python settings."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    environment |= {"MPLBACKEND": "Agg", "UV_SYSTEM_CERTS": "1"}
    command = [str(word) for word in words]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=timeout_s
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    built = run(sys.executable, "-m", "maturin", "build", "--release", "--locked", "--out", folder, cwd=ROOT)
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scripts of an environment that holds the wheel and what it requires, at the versions of the lock."""
    folder = tmp_path_factory.mktemp("outside")
    made = run(find_uv_bin(), "venv", "--no-config", "--python", sys.executable, folder / "env", cwd=folder)
    assert made.returncode == 0, made.stderr
    (scripts,) = (path for name in ("bin", "Scripts") if (path := folder / "env" / name).is_dir())
    words = ("--no-config", "--python", scripts / "python", "--constraint", ROOT / "requirements.lock", wheel)
    done = run(find_uv_bin(), "pip", "install", *words, cwd=folder)
    if done.returncode != 0 and any(words in done.stderr for words in UNREACHABLE):
        pytest.skip("no package index answers, and uv's cache alone does not do")
    assert done.returncode == 0, done.stderr
    return scripts


def test_the_wheel_holds_every_file_of_the_package(wheel: Path) -> None:
    listing = subprocess.run(["git", "ls-files", "src/pavetwin"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode != 0:
        pytest.skip(f"git cannot list the project's files: {listing.stderr.strip()}")
    tracked = {name.removeprefix("src/") for name in listing.stdout.splitlines()}
    with ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if name.startswith("pavetwin/")}
    assert sorted(tracked - held) == []
    assert {name.partition(".")[0] for name in held - tracked} == {"pavetwin/_core"}


def test_the_wheel_brings_nothing_that_only_developers_need(installed: Path) -> None:
    listed = run(find_uv_bin(), "pip", "list", "--no-config", "--python", installed / "python", cwd=installed)
    names = {line.split()[0].lower() for line in listed.stdout.splitlines()[2:]}
    assert "pavetwin" in names
    assert sorted(names & {"pytest", "mypy", "ruff", "hypothesis", "maturin", "uv", "geopandas", "supervision"}) == []


def test_the_demo_runs_where_only_the_wheel_is_installed(installed: Path, tmp_path: Path) -> None:
    ran = run(installed / "pavetwin", "demo", "-o", "demo", cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "demo" / "missions" / "comparison.png").is_file()
    assert (tmp_path / "demo" / "missions" / "hover" / "mission.gif").is_file()
    for policy in ("baseline", "hover", "micro", "skip"):
        assert (tmp_path / "demo" / "missions" / policy / "mission.parquet").is_file()
    printed = [line.rstrip() for line in ran.stdout.splitlines()]
    assert any(line.startswith("Results in ") for line in printed)
    table = readme_table()
    start = printed.index(table[0])
    assert printed[start : start + len(table)] == table


def readme_table() -> list[str]:
    """The README's first result."""
    lines = (ROOT / "README.md").read_text("utf-8").splitlines()
    last = next(number for number, line in enumerate(lines) if line.startswith("skip "))
    first = max(number for number, line in enumerate(lines[:last]) if line == "```")
    return lines[first + 1 : last + 1]
