"""Runs the simulation in a process of its own, and ends it with the caller, however the caller ends."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Final
from xml.etree import ElementTree

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.sumo_run import Job, Outcome
from pavetwin.world.sumo import environment, first_error

GRACE_S: Final = 5.0
"""What SUMO has to end after it was told to, before it is killed."""

UNSORTED: Final = "should be sorted by departure time"
"""In SUMO's warning that it ignores the rest of a routes file."""

OnProgress = Callable[[float], None]
"""Told the share done, 0 … 1."""


def require_sumo() -> None:
    """Raises:
    PaveTwinError: SUMO's library is not on this machine; the message mends it.
    """
    if find_spec("libsumo") is None:
        raise PaveTwinError("SUMO is missing on this machine: install it with `pip install eclipse-sumo libsumo`.")


@contextmanager
def workplace() -> Iterator[Path]:
    """A folder for one run; gone afterwards, however the caller leaves.

    Raises:
        PaveTwinError: there is no room for it.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="pavetwin-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
    except OSError as error:
        place = tempfile.gettempdir() if error.filename is None else error.filename
        raise PaveTwinError(f"Cannot record in '{place}': {error.strerror}. TMPDIR names another place.") from error


def run_job(job: Job, on_progress: OnProgress | None = None) -> Outcome:
    """Run `job` to its end; its folder then holds what SUMO wrote.

    Raises:
        PaveTwinError: SUMO refused its input or crashed; the message holds SUMO's own words.
    """
    folder = Path(job.folder)
    file, words = folder / "job.json", folder / "stderr.txt"
    file.write_text(json.dumps(asdict(job)))
    with words.open("wb") as sink:
        process = subprocess.Popen(
            [sys.executable, "-m", "pavetwin.traffic.sumo_run", str(file)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=sink,
            text=True,
            errors="replace",
            env=_environment(),
            start_new_session=True,  # Ctrl-C is for the caller, who then ends this process
        )
        try:
            said = _follow(process, on_progress)
            code = process.wait()
        finally:
            _end(process)
    stderr = words.read_text(errors="replace")
    if code != 0:
        raise PaveTwinError(_failure(job, code, stderr, said))
    if job.routes and UNSORTED in stderr:
        raise PaveTwinError(
            f"The routes {_names(job)} are not sorted by departure time, and SUMO would drop what comes too late; sort "
            "them (SUMO's tools/route/sort_routes.py does)."
        )
    return Outcome(**json.loads((folder / "run.json").read_text()))


def _follow(process: "subprocess.Popen[str]", on_progress: OnProgress | None) -> str:
    """Pass on the shares reported until the output ends; returns what else was said."""
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        if line.startswith("@"):
            if on_progress is not None:
                on_progress(float(line[1:]))
        else:
            said.append(line)
    return "".join(said)


def _end(process: "subprocess.Popen[str]") -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _failure(job: Job, code: int, stderr: str, stdout: str) -> str:
    words = " ".join(first_error(stderr, stdout).split())
    if damage := _damage(Path(job.network)):
        return (
            f"The world's network '{job.network}' is damaged ({damage}); build the world again with "
            "`pavetwin world build … --force`."
        )
    if code < 0:
        return f"SUMO crashed while recording (signal {-code}); its last words: {words}"
    if job.routes:
        return f"SUMO cannot drive the routes {_names(job)} on this world: {words}"
    return f"SUMO cannot run this traffic: {words}"


def _damage(file: Path) -> str:
    """What is wrong with the XML of a file; empty when it is whole. SUMO does not say which of its files it means."""
    try:
        for _, element in ElementTree.iterparse(file):
            element.clear()
    except (ElementTree.ParseError, OSError) as error:
        return str(error)
    return ""


def _names(job: Job) -> str:
    return ", ".join(f"'{Path(path).name}'" for path in job.routes)


def _environment() -> dict[str, str]:
    """For the simulation's process: SUMO's own data, and the same package as here."""
    try:
        variables = environment()
    except PaveTwinError:  # the library alone is enough to record
        variables = dict(os.environ)
    here = str(Path(__file__).resolve().parents[2])
    variables.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's threads would only wait, and cost time
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, (here, variables.get("PYTHONPATH"))))
    return variables


@contextmanager
def termination_as_exit() -> Iterator[None]:
    """While it lasts, SIGTERM ends the caller through its `finally` blocks, with exit code 143."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def leave(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
