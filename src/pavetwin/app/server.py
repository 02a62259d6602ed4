"""The server of the page: `pavetwin app`."""

import asyncio
from collections.abc import Callable
from typing import Final

from tornado.httpserver import HTTPServer
from tornado.web import Application

from pavetwin.app.guard import Guard
from pavetwin.app.handlers import (
    STATIC,
    ExhibitHandler,
    FileHandler,
    MadeHandler,
    MapHandler,
    PageHandler,
    PlayedHandler,
    ResultHandler,
    StartHandler,
    TownHandler,
    UnknownHandler,
    UploadHandler,
)
from pavetwin.app.live import LARGEST_MESSAGE, LiveHandler
from pavetwin.app.session import Session
from pavetwin.listening import close_all, listening_sockets

TIMEOUT_S: Final = 30.0
"""For the headers of a request, and for its body."""

_BODY: Final = 1 << 16
"""Bytes of a body that is not an upload."""


class AppServer:
    """Listens, answers, and ends with everything that it started."""

    def __init__(self, session: Session, guard: Guard) -> None:
        self._session, self._guard = session, guard
        self._http: HTTPServer | None = None

    def start(self, host: str, port: int) -> int:
        """Listen, within a running event loop.

        Args:
            port: 0 takes a free one.

        Returns:
            The port.

        Raises:
            PaveTwinError: the address is in use, or not of this machine.
        """
        sockets, bound = listening_sockets(host, port)
        own = {"session": self._session, "guard": self._guard}
        application = Application(
            [
                (r"/", PageHandler, own),
                (r"/static/(.+)", FileHandler, {**own, "path": str(STATIC)}),
                (r"/api/start", StartHandler, own),
                (r"/api/worlds/(\w+)/map", MapHandler, own),
                (r"/town/(\w+)/(.+)", TownHandler, own),
                (r"/api/played/(\w+)/files/(.+)", ResultHandler, own),
                (r"/api/played/(\w+)/made/(.+)", MadeHandler, own),
                (r"/api/played/(\w+)/([\w.-]+)", PlayedHandler, own),
                (r"/api/exhibits/(\w+)/([\w.-]+)", ExhibitHandler, own),
                (r"/api/maps/([\w-]+)", UploadHandler, own),
                (r"/live", LiveHandler, own),
            ],
            default_handler_class=UnknownHandler,
            default_handler_args=own,
            log_function=lambda handler: None,  # noqa: ARG005
            bound_port=bound,
            websocket_ping_interval=20,
            websocket_max_message_size=LARGEST_MESSAGE,
        )
        self._http = HTTPServer(
            application, max_body_size=_BODY, body_timeout=TIMEOUT_S, idle_connection_timeout=TIMEOUT_S
        )
        self._http.add_sockets(sockets)
        return bound

    async def stop(self) -> None:
        """Listen no more, close all connections, end all tasks, and remove what was made for the browser."""
        if self._http is not None:
            await close_all(self._http)
        await self._session.close()


async def serve_forever(session: Session, guard: Guard, host: str, port: int, report: Callable[[int], None]) -> None:
    """Run until the task is cancelled.

    Args:
        report: is called with the port once it listens.
    """
    server = AppServer(session, guard)
    try:
        report(server.start(host, port))
        await session.read_ahead()
        await asyncio.Event().wait()
    finally:
        await server.stop()
