"""What libraries print on the error stream does not reach the terminal."""

import os
from pathlib import Path

import pytest

from scenes.command_line import pavetwin_process

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
def test_they_are_shown_on_request(noisy: Path, how: str) -> None:
    words, environment = ([how], {}) if how.startswith("-") else ([], {how: "1"})
    done = pavetwin_process(*words, "fly", "--settings", "--plugin", noisy, env={**os.environ, **environment})
    assert done.returncode == 0
    assert all(words in done.stderr for words in TOLD)


def test_a_warning_about_the_cache_is_told_once(tmp_path: Path) -> None:
    path = tmp_path / "warns.py"
    told = "warnings.warn('Its tiles are made again.', CacheWarning)\n"
    path.write_text(f"import warnings\nfrom pavetwin.errors import CacheWarning\n{told}{told}", encoding="utf-8")
    done = pavetwin_process("fly", "--settings", "--plugin", path)
    assert (done.returncode, done.stderr) == (0, "Its tiles are made again.\n")


def test_the_programs_own_error_is_still_told() -> None:
    for words in ((), ("--verbose",)):
        done = pavetwin_process(*words, "fly", "--settings", "--altitude", "2")
        assert done.returncode == 2
        assert done.stderr.startswith("Error: --altitude 2: ")
