"""Progress and silence on a terminal and in a file."""

import os
import time
from importlib.metadata import version
from pathlib import Path

import pytest
from rich.progress import Progress, TimeRemainingColumn

from pavetwin.cli import app, console
from pavetwin.cli.console import Bar, Lines
from scenes.command_line import pavetwin_process


def test_a_bar_that_begins_something_else_does_not_stay_finished() -> None:
    """After the first part it would show 0:00:00 left until the end."""
    with Progress(TimeRemainingColumn(), disable=True) as bars:
        report = Bar(bars, "Recording")
        report(1.0)
        assert bars.finished
        report(0.0, "Taking images")
        assert not bars.finished
        report(0.5)
        assert bars.tasks[0].completed == 0.5


def test_a_file_gets_a_line_per_stage_and_one_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "STAGE_S", 0.02)
    monkeypatch.setattr(console, "LINE_S", 0.05)
    printed = ""
    with Lines("Starting") as report:
        report(0.0, "Preparing the scene")
        while printed.count("Preparing the scene …\n") < 2:
            time.sleep(0.01)
            printed += capsys.readouterr().err
    capsys.readouterr()
    time.sleep(0.2)
    assert capsys.readouterr().err == ""


def test_a_file_gets_a_line_per_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines("Flying") as report:
        for step in range(1, 41):
            report(step / 40, f"Flying {step}/40")
    printed = capsys.readouterr().err.splitlines()
    assert printed == [f"Flying {4 * tenth}/40 ({10 * tenth}%)" for tenth in range(1, 11)]


def test_counts_in_the_middle_of_a_line_begin_no_stage_of_their_own(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, "STAGE_S", 0.2)
    with Lines("Starting") as report:
        for step in range(30):
            report(0.0, f"Recording traffic {step}/99, flying missions 0/8")
            time.sleep(0.02)
    assert "Recording traffic" in capsys.readouterr().err


def test_only_long_stages_get_a_line_in_a_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with console.progress("Preparing") as report:
        for step in range(10):
            report(step / 10)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(console, "STAGE_S", 0.05)
    with console.progress("Preparing") as report:
        report(0.3)
        time.sleep(0.3)
    assert "Preparing (30%)\n" in capsys.readouterr().err


def test_the_version_is_printed_without_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    app(["--version"], standalone_mode=False)
    assert capsys.readouterr().out == f"PaveTwin {version('pavetwin')}\n"


def test_a_given_time_left_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    with Lines("Flying") as report:
        report(0.25, "Flying", 61.4)
    assert capsys.readouterr().err == "Flying (25%, 0:01:01 left)\n"


NOISY = """
import ctypes, logging, subprocess, sys, warnings

warnings.warn("a warning of Python")
logging.getLogger("library").warning("a log without a handler")
ctypes.CDLL(None).write(2, b"a native library\\n", 17)
subprocess.run([sys.executable, "-c", "import sys; print('a child process', file=sys.stderr)"], check=True)
"""
TOLD = ("a warning of Python", "a log without a handler", "a native library", "a child process")


@pytest.fixture
def noisy(tmp_path: Path) -> Path:
    path = tmp_path / "noisy.py"
    path.write_text(NOISY, encoding="utf-8")
    return path


def test_messages_of_libraries_are_dropped(noisy: Path) -> None:
    done = pavetwin_process("fly", "--settings", "--plugin", noisy)
    assert (done.returncode, done.stderr) == (0, "")
    assert "altitude_m" in done.stdout


@pytest.mark.parametrize("how", ["--verbose", "PAVETWIN_DEBUG"])
def test_messages_of_libraries_are_shown_on_request(noisy: Path, how: str) -> None:
    words, environment = ([how], {}) if how.startswith("-") else ([], {how: "1"})
    done = pavetwin_process(*words, "fly", "--settings", "--plugin", noisy, env={**os.environ, **environment})
    assert done.returncode == 0
    assert all(words in done.stderr for words in TOLD)


def test_a_warning_about_the_cache_is_printed_once(tmp_path: Path) -> None:
    path = tmp_path / "warns.py"
    warning = "warnings.warn('Its tiles are made again.', CacheWarning)\n"
    path.write_text(f"import warnings\nfrom pavetwin.errors import CacheWarning\n{warning}{warning}", encoding="utf-8")
    done = pavetwin_process("fly", "--settings", "--plugin", path)
    assert (done.returncode, done.stderr) == (0, "Its tiles are made again.\n")


def test_the_programs_own_error_is_printed() -> None:
    for words in ((), ("--verbose",)):
        done = pavetwin_process(*words, "fly", "--settings", "--altitude", "2")
        assert done.returncode == 2
        assert done.stderr.startswith("Error: --altitude 2: ")
