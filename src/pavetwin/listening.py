"""Listening sockets of a server, and running until SIGTERM or SIGINT."""

import asyncio
import errno
import signal
import socket
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets

from pavetwin.errors import PaveTwinError

CLOSING_S: Final = 5.0
"""Connections have so long to end: Tornado waits for the tasks that serve them, and these for their clients."""


def listening_sockets(host: str, port: int) -> tuple[list[socket.socket], int]:
    """Sockets that listen at an address, and their port.

    Args:
        port: 0 takes a free one.

    Raises:
        PaveTwinError: the address is in use, or not of this machine.
    """
    try:
        sockets = bind_sockets(port, host)
    except (OSError, UnicodeError) as error:
        if getattr(error, "errno", None) == errno.EADDRINUSE:
            raise PaveTwinError(f"`port` {port}: it is in use at {host}; choose another.") from error
        raise PaveTwinError(f"`host` {host}: no listening there ({error}); 127.0.0.1 is this machine.") from error
    return sockets, int(sockets[0].getsockname()[1])


async def close_all(server: HTTPServer) -> None:
    """Listen no more, and close all connections; one that does not end by then ends with the process."""
    server.stop()
    with suppress(TimeoutError):
        await asyncio.wait_for(server.close_all_connections(), CLOSING_S)


def run_until_terminated(serving: Coroutine[Any, Any, None]) -> bool:
    """Run a server; True where SIGTERM ended it.

    SIGTERM cancels the task: an exception of its handler would be lost where it met the task of a request.
    """

    async def until_terminated() -> None:
        task = asyncio.current_task()
        assert task is not None
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
        await serving

    try:
        asyncio.run(until_terminated())
    except asyncio.CancelledError:
        return True
    return False
