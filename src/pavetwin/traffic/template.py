"""The template of simulations' processes: `python -m pavetwin.traffic.template`.

To import libsumo and NumPy takes half a second of processor time, more than to simulate light traffic. So an owner
starts one process that has them imported and simulates nothing, and that forks a process for each simulation. It runs
no threads: a fork of a process with threads may hang.

Its standard input is one end of a socket. For each simulation comes a byte with three handles: the simulation's end of
the connection with its owner, the file that its words go to, and the line on which the template says that the process
has begun (`BEGUN`) and then how it ended (`ENDED`), and on which the owner sends signals to it, by their numbers. Only
the template can do that: it knows until when a process has its number. When the other end of the socket is closed, the
owner is done or was killed, and the template ends after the last of its simulations.
"""

import gc
import os
import selectors
import signal
import socket
import struct
import sys
import traceback
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Final, NoReturn

from pavetwin.traffic.sumo_run import serve

BEGUN: Final = b"!"
ENDED: Final = struct.Struct("i")
"""The exit code; −n after signal n."""

HANDLES: Final = 3
"""That come with each simulation."""


class Template:
    """Forks simulations for the owner at the other end of a socket."""

    def __init__(self, owner: socket.socket) -> None:
        self._owner = owner
        self._lines: dict[int, socket.socket] = {}
        """Of the processes that have not ended, by their numbers."""
        self._ended, self._alarm = socket.socketpair()
        """Python writes a byte into the second when a process has ended."""
        self._selector = selectors.DefaultSelector()

    def run(self) -> None:
        self._alarm.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda *_: None)  # only what has a handler wakes us
        signal.set_wakeup_fd(self._alarm.fileno(), warn_on_full_buffer=False)
        self._selector.register(self._owner, selectors.EVENT_READ)
        self._selector.register(self._ended, selectors.EVENT_READ)
        while self._owner.fileno() >= 0 or self._lines:
            for key, _ in self._selector.select():
                if key.fileobj is self._owner:
                    self._begin()
                elif key.fileobj is self._ended:
                    self._reap()
                elif key.data in self._lines:
                    self._pass_on(key.data)

    def _begin(self) -> None:
        """Fork one simulation. Where that fails its line is closed without a word."""
        message, handles, _, _ = socket.recv_fds(self._owner, 1, HANDLES)
        if not message:
            self._forget(self._owner)
            return
        connection, words, handle = handles
        line = socket.socket(fileno=handle)
        try:
            process = os.fork()
        except OSError:
            line.close()
        else:
            if process == 0:
                self._simulate(connection, words, line)
            self._lines[process] = line
            self._selector.register(line, selectors.EVENT_READ, process)
            with suppress(OSError):  # the owner is gone
                line.sendall(BEGUN)
        os.close(connection)
        os.close(words)

    def _simulate(self, connection: int, words: int, line: socket.socket) -> NoReturn:
        """Go on as the simulation's process, with nothing that belongs to the template or to other simulations."""
        code = 1
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.setsid()  # Ctrl-C is for the owner, who then ends this process
            self._selector.close()
            for held in (self._owner, self._ended, self._alarm, line, *self._lines.values()):
                held.close()
            for handle, place in ((connection, sys.stdin), (words, sys.stdout), (words, sys.stderr)):
                os.dup2(handle, place.fileno())
            os.close(connection)
            os.close(words)
            code = serve(Connection(sys.stdin.fileno()))
        except BaseException:  # whatever it is, this process ends here
            traceback.print_exc()
        finally:
            _flush()
            os._exit(code)

    def _reap(self) -> None:
        """Say of each process that has ended how it did."""
        self._ended.recv(4096)
        for process, line in list(self._lines.items()):
            ended, status = os.waitpid(process, os.WNOHANG)
            if ended:
                del self._lines[process]
                with suppress(OSError):
                    line.sendall(ENDED.pack(os.waitstatus_to_exitcode(status)))
                self._forget(line)

    def _pass_on(self, process: int) -> None:
        """Signals from the owner to a process."""
        numbers = b""
        with suppress(OSError):
            numbers = self._lines[process].recv(16)
        for number in numbers:
            os.kill(process, number)
        if not numbers:  # nobody wants to hear of it any more; it ends with its own connection
            self._selector.unregister(self._lines[process])

    def _forget(self, end: socket.socket) -> None:
        with suppress(KeyError):
            self._selector.unregister(end)
        end.close()


def _flush() -> None:
    for file in (sys.stdout, sys.stderr):
        with suppress(OSError):
            file.flush()


def main() -> NoReturn:
    with suppress(ImportError):  # the simulation tries again, and says what is wrong
        import libsumo  # noqa: F401
    _flush()  # what libsumo says of itself is not a simulation's
    gc.freeze()  # a collection in a simulation's process leaves alone, and so does not copy, what all of them share
    Template(socket.socket(fileno=sys.stdin.fileno())).run()
    os._exit(0)


if __name__ == "__main__":
    main()
