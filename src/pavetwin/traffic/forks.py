"""Processes for simulations, forked off one template for this process (see `template`)."""

import atexit
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

from pavetwin.errors import PaveTwinError
from pavetwin.traffic.template import BEGUN, ENDED

END_S: Final = 0.5
"""What the template has to end when this process does; with a simulation alive it ends after it, by itself."""


class Fork:
    """A simulation's process, from its beginning to its exit code."""

    def __init__(self, line: socket.socket) -> None:
        """`line`: to the template, which has said there that the process has begun."""
        self._line, self._owner = line, os.getpid()

    def wait(self, timeout_s: float | None = None) -> int | None:
        """The exit code, −n after signal n; None where the template was killed, so that nobody knows.

        Raises:
            TimeoutError: the process has not ended by then.
        """
        self._line.settimeout(timeout_s)
        try:
            word = self._line.recv(ENDED.size)
        except ConnectionError:
            return None
        return int(ENDED.unpack(word)[0]) if len(word) == ENDED.size else None

    def end(self, grace_s: float) -> None:
        """End the process, by force where it does not within `grace_s`. In a fork of its owner nothing happens."""
        if os.getpid() == self._owner:
            try:
                self._send(signal.SIGTERM)
                self.wait(grace_s)
            except TimeoutError:
                self._send(signal.SIGKILL)
                self.wait()
        self._line.close()

    def _send(self, number: signal.Signals) -> None:
        with suppress(ConnectionError):  # its template was killed; then it ends with the connection to its owner
            self._line.sendall(bytes([number]))


class _Template:
    """The process that forks, as its owner knows it."""

    def __init__(self, variables: Mapping[str, str]) -> None:
        self._requests, its_end = socket.socketpair()
        with its_end:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "pavetwin.traffic.template"],
                stdin=its_end.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=dict(variables),
                start_new_session=True,
            )

    def fork(self, connection: int, words: int) -> Fork | None:
        """A simulation's process; None where the template cannot, or was killed."""
        line, its_end = socket.socketpair()
        try:
            with its_end:
                socket.send_fds(self._requests, [BEGUN], [connection, words, its_end.fileno()])
            if line.recv(1) == BEGUN:
                return Fork(line)
        except ConnectionError:
            pass
        except BaseException:
            line.close()
            raise
        line.close()
        return None

    def let_go(self) -> None:
        """Take no more requests."""
        self._requests.close()

    def end(self) -> int | None:
        """Its exit code; None where a simulation keeps it."""
        self.let_go()
        with suppress(subprocess.TimeoutExpired):
            return self._process.wait(END_S)
        return None


_lock = threading.Lock()
_template: _Template | None = None
"""Of this process; made when it is first needed."""


def fork(connection: int, words: int, variables: Mapping[str, str]) -> Fork:
    """A process that serves an owner at the other end of `connection`, and writes what it says to `words`.

    `variables` are the environment of the template, which the first call makes.

    Raises:
        PaveTwinError: no process can be had.
    """
    global _template
    code = None
    with _lock:
        for _ in range(2):  # one that was killed is replaced
            if _template is None:
                _template = _Template(variables)
            if begun := _template.fork(connection, words):
                return begun
            code, _template = _template.end(), None
    raise PaveTwinError(f"No process for SUMO can be started here: one to begin with ended with exit code {code}.")


def _forget() -> None:
    """In a fork of this process: the template is its parent's, who must be the only one to hold it."""
    global _lock, _template
    _lock = threading.Lock()
    if _template is not None:
        _template.let_go()
        _template = None


@atexit.register
def _end() -> None:
    if _template is not None:
        _template.end()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_forget)
