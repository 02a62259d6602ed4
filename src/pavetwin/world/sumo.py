"""SUMO's tools, located when needed and run as separate processes.

No internet access is needed: schemas and type maps come from the installation.
"""

import os
import shutil
import subprocess
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from pavetwin.errors import PaveTwinError

NO_VALIDATION = ("--xml-validation", "never")
"""Options that keep a SUMO tool from downloading a schema."""

INSTALL_HINT = "install it with `pip install eclipse-sumo`, or set SUMO_HOME to your own installation"


def sumo_home() -> Path:
    """SUMO's folder (it holds `bin/` and `data/`): the wheel's, else SUMO_HOME, else the one that PATH leads to.

    Raises:
        PaveTwinError: there is none on this machine.
    """
    for home in _candidates():
        if any((home / "bin" / name).is_file() for name in ("netconvert", "netconvert.exe")):
            return home
    raise PaveTwinError(f"SUMO is not installed on this machine; {INSTALL_HINT}.")


def _candidates() -> list[Path]:
    candidates = []
    wheel = find_spec("sumo")
    if wheel is not None and wheel.submodule_search_locations:
        candidates += [Path(place) for place in wheel.submodule_search_locations]
    if given := os.environ.get("SUMO_HOME"):
        candidates.append(Path(given))
    if on_path := shutil.which("netconvert"):
        binary = Path(on_path).resolve()
        candidates += [binary.parent.parent, binary.parent.parent / "share" / "sumo"]
    return candidates


def tool(name: str) -> Path:
    """The path of one of SUMO's programs: `netconvert`, `netgenerate`, `sumo` …

    Raises:
        PaveTwinError: SUMO or this program of it is not on this machine.
    """
    folder = sumo_home() / "bin"
    for candidate in (folder / name, folder / f"{name}.exe"):
        if candidate.is_file():
            return candidate
    raise PaveTwinError(f"SUMO's program '{name}' is not in '{folder}'; {INSTALL_HINT}.")


def data_file(relative: str) -> Path:
    """A file that SUMO ships, such as `typemap/osmNetconvert.typ.xml`.

    Raises:
        PaveTwinError: this installation does not have it.
    """
    home = sumo_home()
    for folder in (home / "data", home.parent / "share" / "sumo" / "data"):
        if (folder / relative).is_file():
            return folder / relative
    raise PaveTwinError(f"SUMO's file 'data/{relative}' is missing below '{home}'; {INSTALL_HINT}.")


def environment() -> dict[str, str]:
    """This process's environment with SUMO_HOME set, for a SUMO process."""
    return {**os.environ, "SUMO_HOME": str(sumo_home())}


def run_tool(name: str, arguments: Sequence[str], *, doing: str, timeout_s: float = 1800.0) -> str:
    """Run one of SUMO's programs to its end and return what it printed.

    `doing` begins the message when it fails ("building the road network").

    Raises:
        PaveTwinError: SUMO is missing, or the program failed; the message holds its first line with 'Error'.
    """
    command = [str(tool(name)), *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", env=environment(), timeout=timeout_s, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise PaveTwinError(f"{doing}: SUMO's {name} took longer than {timeout_s:.0f} s and was stopped.") from error
    except OSError as error:
        raise PaveTwinError(f"{doing}: SUMO's {name} cannot be started ({error.strerror}); {INSTALL_HINT}.") from error
    if done.returncode != 0:
        raise PaveTwinError(f"{doing}: {first_error(done.stderr, done.stdout)}")
    return done.stdout


def first_error(*outputs: str) -> str:
    """The first line with 'Error' in what a SUMO tool printed, without the word; else its last line."""
    lines = [line.strip() for output in outputs for line in output.splitlines() if line.strip()]
    for line in lines:
        if line.startswith("Error"):
            return line.removeprefix("Error:").strip()
    return lines[-1] if lines else "it ended without a message"
