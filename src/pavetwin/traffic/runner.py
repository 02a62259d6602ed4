"""Runs the simulation in a separate process that ends with the caller, however the caller ends."""

import atexit
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Final
from xml.etree import ElementTree

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.job import OUTPUT, Part, SimulationJob
from pavetwin.world.sumo import environment, first_error

GRACE_S: Final = 5.0
"""Time between SIGTERM and SIGKILL."""

UNSORTED: Final = "should be sorted by departure time"
"""Part of SUMO's warning that it ignores the rest of a routes file."""

OnRecorded = Callable[[float], None]
"""Called with the share done, 0 … 1."""


def require_sumo() -> None:
    """Raises:
    PaveTwinError: SUMO's library is not installed.
    """
    if find_spec("libsumo") is None:
        raise PaveTwinError("SUMO is missing on this machine: install it with `pip install eclipse-sumo libsumo`.")


@contextmanager
def workplace() -> Iterator[Path]:
    """A temporary folder for one simulation.

    Raises:
        PaveTwinError: the disk is full.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="pavetwin-", ignore_cleanup_errors=True) as folder:
            yield Path(folder)
    except OSError as error:
        place = tempfile.gettempdir() if error.filename is None else error.filename
        raise PaveTwinError(f"Cannot record in '{place}': {error.strerror}. TMPDIR names another place.") from error


class SimulationProcess:
    """SUMO in a separate process. It is paused between two calls of `record`, and ends with its owner."""

    def __init__(self, job: SimulationJob) -> None:
        self._job, self._output = job, Path(job.folder) / OUTPUT
        self._owner_process = os.getpid()
        self._asked = 0
        """Requests that are not answered yet."""
        kept = _Kept.take()
        if kept is None:
            self._start()
        else:
            self._owner, self._process = kept
            self._output.touch()
        with suppress(ConnectionError):  # `finish` reports the failure
            self._owner.send(job)

    def _start(self) -> None:
        self._owner, its_end = Pipe()
        with its_end, self._output.open("wb") as sink:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pavetwin.traffic.sumo_run"],
                stdin=its_end.fileno(),
                stdout=sink,
                stderr=sink,
                env=_environment(),
                start_new_session=True,  # Ctrl-C reaches the owner, which then ends this process
            )

    def record(self, frames: int, on_progress: OnRecorded | None = None) -> Part:
        """The next `frames` frames; the first time the warm-up comes before them.

        Raises:
            PaveTwinError: SUMO refused its input or crashed; the message holds that of SUMO.
        """
        self.begin(frames)
        return self.finish(on_progress)

    def begin(self, frames: int) -> None:
        """Record the next `frames` frames, without waiting for them."""
        self._asked += 1
        with suppress(ConnectionError):  # `finish` reports the failure
            self._owner.send(frames)

    def finish(self, on_progress: OnRecorded | None = None) -> Part:
        """The frames that were begun.

        Raises:
            PaveTwinError: as `record`.
        """
        try:
            while not isinstance(answer := self._owner.recv(), Part):
                if on_progress is not None:
                    on_progress(answer)
        except (EOFError, ConnectionError):
            code = self._process.wait()
            raise PaveTwinError(_failure(self._job, code, self._printed())) from None
        self._asked -= 1
        if self._job.routes and UNSORTED in self._printed():
            raise PaveTwinError(
                f"The routes {_names(self._job)} are not sorted by departure time, and SUMO would skip late ones; "
                "sort them (SUMO's tools/route/sort_routes.py does)."
            )
        return answer

    def close(self) -> None:
        """End the process, or keep it for the next simulation (`keep_process`); in a fork of its owner, only close the
        connection."""
        if os.getpid() != self._owner_process:
            self._owner.close()
            return
        if not self._asked and _Kept.leave(self._owner, self._process):
            return
        _end(self._owner, self._process)

    def _printed(self) -> str:
        return self._output.read_text(errors="replace")


def keep_process() -> None:
    """Keep the process of an ended simulation for the next one, from now on.

    For many simulations: a process that has SUMO loaded takes 0.4 s of processor time to start. One is
    kept at a time, and ends with this process.
    """
    _Kept.owner = os.getpid()
    atexit.register(_Kept.end)


class _Kept:
    """The process that waits for its next simulation."""

    owner: int | None = None
    """The process that keeps one; a fork of it keeps none."""
    waiting: tuple[Connection, subprocess.Popen[bytes]] | None = None

    @classmethod
    def leave(cls, connection: Connection, process: subprocess.Popen[bytes]) -> bool:
        """Whether the process is kept; it is notified that its simulation has ended."""
        if cls.owner != os.getpid() or cls.waiting is not None:
            return False
        try:
            connection.send(None)
        except OSError:  # it has ended, or was closed before
            return False
        cls.waiting = connection, process
        return True

    @classmethod
    def end(cls) -> None:
        """End the one that waits."""
        if cls.owner == os.getpid() and cls.waiting is not None:
            kept, cls.waiting = cls.waiting, None
            _end(*kept)

    @classmethod
    def take(cls) -> tuple[Connection, subprocess.Popen[bytes]] | None:
        """The idle process, if its last simulation was closed without a crash or hang."""
        if cls.owner != os.getpid() or cls.waiting is None:
            return None
        kept, cls.waiting = cls.waiting, None
        connection, process = kept
        with suppress(EOFError, OSError):
            if connection.poll(GRACE_S) and connection.recv() is None and process.poll() is None:
                return kept
        _end(*kept)
        return None


def _end(connection: Connection, process: subprocess.Popen[bytes]) -> None:
    """End a process, by force where it takes longer than `GRACE_S`."""
    connection.close()
    process.terminate()
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _failure(job: SimulationJob, code: int, printed: str) -> str:
    message = " ".join(first_error(printed).split())
    if damage := _damage(Path(job.network)):
        return (
            f"The world's network '{job.network}' is damaged ({damage}); build the world again with "
            "`pavetwin world build SOURCE --force`."
        )
    if code < 0:
        return f"SUMO crashed while recording (signal {-code}); its last message: {message}"
    if job.routes:
        return f"SUMO cannot drive the routes {_names(job)} on this world: {message}"
    return f"SUMO cannot run this traffic: {message}"


def _damage(file: Path) -> str:
    """The XML error of a file; empty when it is well-formed. SUMO's messages do not name the file."""
    try:
        for _, element in ElementTree.iterparse(file):
            element.clear()
    except (ElementTree.ParseError, OSError) as error:
        return str(error)
    return ""


def _names(job: SimulationJob) -> str:
    return ", ".join(f"'{Path(path).name}'" for path in job.routes)


def _environment() -> dict[str, str]:
    """Environment of the simulation's process: SUMO's own data, and the same package as here."""
    try:
        variables = environment()
    except PaveTwinError:  # the library alone is enough to record
        variables = dict(os.environ)
    here = str(Path(__file__).resolve().parents[2])
    variables.setdefault("OPENBLAS_NUM_THREADS", "1")  # idle threads of numpy cost time
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
