"""The process that runs tasks for the page: `python -m pavetwin.app.task_process`.

It reads one task per line from its input, and messages to the running task, and writes lines of JSON: progress, then a
result or an error. Tracebacks of internal errors go to the error stream. The process ends when its input closes, so
that it does not outlive the server, and ends its child processes, since it leads a session of its own.
"""

import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from contextlib import suppress
from types import FrameType
from typing import IO, Any, Final, NoReturn, Protocol

from pavetwin.errors import PaveTwinError
from pavetwin.files import hint

GRACE_S: Final = 5.0
"""Time to remove temporary files on termination before a kill."""

MESSAGE: Final = "message"
"""Key of a message to the running task."""

EVERY_S: Final = 0.1
"""Least time between two reports of progress of one stage."""


class TaskReport(Protocol):
    """Channel of a task to the page."""

    def __call__(self, share: float, what: str, /) -> None:
        """The share done, 0 … 1, and what is being done."""

    def ready(self, values: Mapping[str, Any], /) -> None:
        """Report data that is usable while the task continues."""

    def live(self, values: Mapping[str, Any], /) -> None:
        """Report the present state of a task that runs with the clock."""

    def messages(self) -> list[Mapping[str, Any]]:
        """Messages to the task since the last call, in order."""
        ...


def failure_words(error: Exception) -> str:
    """A failure in one line, with a hint; an internal error asks for a report."""
    if isinstance(error, PaveTwinError):
        return str(error)
    if isinstance(error, MemoryError):
        return "It needs more memory than the page may use."
    if isinstance(error, OSError):
        place = f" ('{error.filename}')" if error.filename else ""
        return f"The server could not do this: {error.strerror or error}{place}. {hint(error, 'try it again')}."
    return f"Unexpected failure: {type(error).__name__}: {' '.join(str(error).split())}. Please report it."


def main() -> None:
    """Run tasks until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which then ends this process
    signal.signal(signal.SIGTERM, _exit)
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is not a reply
    tasks: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(tasks,), daemon=True).start()
    from pavetwin.app import tasks as known  # loads what flies, while the server waits for the first task

    while True:
        task = json.loads(tasks.get())
        if MESSAGE not in task:  # else a message to a finished task
            _write(replies, _reply(known, task, _Progress(replies, tasks)))


def _reply(known: Any, task: Mapping[str, Any], progress: "_Progress") -> Mapping[str, Any]:
    try:
        return {"result": known.run(task, progress)}
    except Exception as error:
        if not isinstance(error, PaveTwinError):
            traceback.print_exception(error)  # where the server was started, for a report of the fault
        return {"error": failure_words(error)}


class _Progress:
    """Progress to the server at a limited rate, and messages from it."""

    def __init__(self, replies: IO[str], lines: "queue.SimpleQueue[str]") -> None:
        self._replies, self._lines, self._what, self._reported_s = replies, lines, "", 0.0

    def __call__(self, share: float, what: str) -> None:
        now_s = time.monotonic()
        if what == self._what and now_s - self._reported_s < EVERY_S:
            return
        self._what, self._reported_s = what, now_s
        _write(self._replies, {"share": round(share, 3), "what": what})

    def ready(self, values: Mapping[str, Any]) -> None:
        _write(self._replies, {"ready": values})

    def live(self, values: Mapping[str, Any]) -> None:
        _write(self._replies, {"live": values})

    def messages(self) -> list[Mapping[str, Any]]:
        messages = []
        with suppress(queue.Empty):
            while True:
                messages.append(json.loads(self._lines.get_nowait())[MESSAGE])
        return messages


def _write(replies: IO[str], message: Mapping[str, Any]) -> None:
    with suppress(BrokenPipeError):  # the server is gone; the end of the input ends this process
        replies.write(json.dumps(message) + "\n")  # in ASCII: a browser may have sent half a pair of surrogates
        replies.flush()


def _read(tasks: "queue.SimpleQueue[str]") -> None:
    """Take tasks as they come; at the end of the input, end."""
    for line in sys.stdin:
        tasks.put(line)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    if os.getpgid(0) == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _exit(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 - the signature of a handler
    """Leave through the `finally` blocks, once: a second signal must not interrupt these."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(128 + number)


if __name__ == "__main__":
    main()
