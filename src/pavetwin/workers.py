"""A pool of worker processes. A worker that dies is replaced, and its task is run again a bounded number of times.

Each worker has a connection of its own, so it is known which task a death has cost; the other workers keep theirs.
"""

import multiprocessing
import os
import pickle
import signal
import threading
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import FrameType
from typing import Any, Final, Generic, NoReturn, Self, TypeVar

from pavetwin.errors import CacheWarning

ATTEMPTS: Final = 3
"""A task whose worker dies this often is given up: the task itself may be what kills them."""

GRACE_S: Final = 5.0
"""Time for a worker to remove its temporary files after SIGTERM, before it is killed."""

WORKER_BYTES: Final = 2 * 2**30
"""A process that renders needs so much at most."""

WORTH_STARTING: Final = 10
"""Images that take about as long as a process that renders takes to start."""

Task = TypeVar("Task")
Result = TypeVar("Result")
OnTick = Callable[[], None]


def default_jobs(images: int) -> int:
    """Number of processes that render some images: one for each core of this process, within the free memory, and no
    more than are worth starting; one at least."""
    return max(1, min(cores(), _spare_bytes() // WORKER_BYTES, images // WORTH_STARTING))


def cores() -> int:
    """The cores of this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def may_start() -> bool:
    """Whether this process may have processes of its own: a worker of `multiprocessing` may not."""
    return not multiprocessing.current_process().daemon


def _spare_bytes() -> int:
    """Memory available to new processes without swapping, as the kernel estimates it; half of the total on other
    systems."""
    with suppress(OSError), Path("/proc/meminfo").open(encoding="ascii") as file:
        for name, value, *_ in map(str.split, file):
            if name == "MemAvailable:":
                return int(value) * 1024
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2


class WorkerPool(Generic[Task, Result]):
    """Runs tasks in up to `workers` processes, which start when tasks need them and end with the `with` block."""

    def __init__(
        self,
        workers: int,
        start: Callable[[OnTick], Callable[[Task], Result]],
        on_tick: OnTick = lambda: None,
        waiting: Iterable["WaitingProcess"] = (),
    ) -> None:
        """Args:
        start: called once in each worker, before its first task; returns what runs a task. It is given a function that
            reports progress. It is pickled: a function at the top of a module, or a `partial` of one.
        on_tick: called here for each report of progress.
        waiting: processes that were started before, see `started`, and become its first workers.
        """
        self._workers, self._start, self._on_tick = workers, start, on_tick
        self._waiting = deque(waiting)
        self._pool: list[_Worker[Task]] = []

    def run(
        self,
        tasks: Iterable[Task],
        on_result: Callable[[Task, Result], None],
        *,
        give_up: Callable[[Task], None],
        remaining: Callable[[Task], Iterable[Task]] = lambda task: [task],
    ) -> None:
        """Run all tasks; they begin in this order and end in any. The first exception that a task raises is raised.

        Args:
            remaining: what is left of a task whose worker died, in one or several tasks.
            give_up: called with a task whose worker died for the last time.
        """
        waiting = deque((task, 0) for task in tasks)
        while waiting or any(worker.busy for worker in self._pool):
            while waiting and (idle := self._idle()):
                idle.begin(*waiting.popleft())
            connections = {worker.connection: worker for worker in self._pool if worker.busy}
            for ready in wait(connections):
                worker = connections[ready]  # type: ignore[index]  # only connections are waited for
                try:
                    answer = worker.connection.recv()
                except (EOFError, ConnectionError):
                    task, deaths = worker.task, worker.deaths + 1
                    worker.stop()
                    self._pool.remove(worker)
                    if deaths < ATTEMPTS:
                        waiting.extend((part, deaths) for part in remaining(task))
                    else:
                        give_up(task)
                    continue
                if answer is None:
                    self._on_tick()
                elif isinstance(answer, Warning):
                    warnings.warn(answer, stacklevel=2)
                elif isinstance(answer, Exception):
                    raise answer
                else:
                    worker.busy = False
                    on_result(worker.task, answer[0])

    def _idle(self) -> "_Worker[Task] | None":
        for worker in self._pool:
            if not worker.busy:
                return worker
        if len(self._pool) == self._workers:
            return None
        process = self._waiting.popleft() if self._waiting else WaitingProcess()
        self._pool.append(_Worker(process, self._start))
        return self._pool[-1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._pool:
            worker.process.terminate()
        for worker in self._pool:
            worker.stop()


class WaitingProcess:
    """A process that waits for a task."""

    def __init__(self, module: str = "", ahead: Callable[[], object] | None = None) -> None:
        """Args:
        module: what it imports meanwhile.
        ahead: what it does then. Pickled as the `start` of a pool, which finds what a module kept of it; what it raises
            is left to that.
        """
        self.connection, theirs = multiprocessing.Pipe()
        with theirs:
            context: Any = multiprocessing.get_context("spawn")
            self.process = context.Process(target=_serve, args=(theirs, module, ahead), daemon=True)
            self.process.start()

    def stop(self) -> None:
        """End the process, by force after `GRACE_S`."""
        self.process.terminate()
        self.process.join(GRACE_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


@contextmanager
def started(
    workers: int, module: str = "", ahead: Callable[[], object] | None = None
) -> Iterator[list[WaitingProcess]]:
    """Processes for a pool that is made within it, which meanwhile get what they will need (`WaitingProcess`)."""
    processes = [WaitingProcess(module, ahead) for _ in range(workers)]
    try:
        yield processes
    finally:
        for each in processes:
            each.connection.close()  # who still waits ends then


class _Worker(Generic[Task]):
    """A worker process as its parent sees it."""

    def __init__(self, process: WaitingProcess, start: Callable[[OnTick], Callable[[Task], Any]]) -> None:
        self._waiting, self.connection, self.process = process, process.connection, process.process
        with suppress(ConnectionError):  # it died while waiting; the end of the connection is read next
            self.connection.send(start)
        self.busy = False
        self.task: Task
        self.deaths = 0
        """How many workers this task has cost."""

    def begin(self, task: Task, deaths: int) -> None:
        self.task, self.deaths, self.busy = task, deaths, True
        with suppress(ConnectionError):  # it died while idle; the end of the connection is read next
            self.connection.send(task)

    def stop(self) -> None:
        self.connection.close()
        self._waiting.stop()


# --- In the worker process ------------------------------------------------------------------------------------------


def _serve(connection: Connection, module: str, ahead: Callable[[], object] | None) -> None:
    """Run tasks until the parent closes the connection, from which comes first what starts them. A result goes back in
    a tuple; None reports progress; a warning about the cache is given by the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then ends this process
    signal.signal(signal.SIGTERM, _exit)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    warnings.showwarning = partial(_pass_on, connection)
    if module:
        import_module(module)
    if ahead is not None:
        with suppress(Exception):
            ahead()
    start: Callable[[OnTick], Callable[[Any], Any]] | None = None
    run: Callable[[Any], Any] | None = None
    while True:
        try:
            start = start or connection.recv()
            task = connection.recv()
        except (EOFError, ConnectionError):
            return
        try:
            assert start is not None
            run = run or start(partial(connection.send, None))
            answer: object = (run(task),)
        except Exception as error:
            answer = _picklable(error)
        connection.send(answer)


def _pass_on(connection: Connection, message: Warning | str, category: type[Warning], *_: object) -> None:
    """Pass a worker's warning about the cache to the parent, which shows it once; those of libraries are dropped."""
    if issubclass(category, CacheWarning):
        connection.send(message)


def _exit(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of a handler
    """SIGTERM ends the process through its `finally` blocks, once: a second one must not interrupt these."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(128 + number)


def _die_with_parent() -> None:
    """End with a parent that was killed and so cannot end its workers."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _picklable(error: Exception) -> Exception:
    """The error with its traceback in the worker as a note."""
    note = "In a worker process:\n" + "".join(traceback.format_exception(error))
    error.add_note(note)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
        error.add_note(note)
    return error
