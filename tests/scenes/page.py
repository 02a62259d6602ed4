"""The page's server in a thread of this process, and clients that speak plain HTTP and WebSocket to it."""

import asyncio
import http.client
import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from pavetwin.app.guard import COOKIE, Guard
from pavetwin.app.server import AppServer
from pavetwin.app.session import WORLDS, Session


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def values(self) -> Any:
        return json.loads(self.body)


@dataclass(frozen=True)
class RunningPage:
    session: Session
    guard: Guard
    port: int

    @property
    def cookie(self) -> dict[str, str]:
        return {"Cookie": f"{COOKIE}-{self.port}={self.guard.token}"}

    def get(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
        """Request of a browser that has the page open, with other or more headers."""
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        try:
            connection.request(method, path, body, {**self.cookie, **named})
            answer = connection.getresponse()
            return Answer(answer.status, answer.headers, answer.read())
        finally:
            connection.close()

    async def connect(self, **headers: str) -> WebSocketClientConnection:
        asked = HTTPRequest(f"ws://127.0.0.1:{self.port}/live", headers={**self.cookie, **headers})
        return await websocket_connect(asked)

    def ask(self, *tasks: dict[str, Any]) -> list[dict[str, Any]]:
        """The last message of each task of one page, one after the other."""
        return asyncio.run(self._ask(tasks))

    async def _ask(self, tasks: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        page = await self.connect()
        try:
            return [await result_of(page, {"world": "w0", **task, "id": number}) for number, task in enumerate(tasks)]
        finally:
            page.close()


async def result_of(
    page: WebSocketClientConnection, task: dict[str, Any], told: Callable[[dict[str, Any]], None] = lambda _: None
) -> dict[str, Any]:
    """Ask for a task, and wait for its last message."""
    await page.write_message(json.dumps(task))
    while (message := await page.read_message()) is not None:
        answer: dict[str, Any] = json.loads(message)
        if answer["id"] == task["id"] and {"done", "error", "cancelled"} & answer.keys():
            return answer
        told(answer)
    return {"closed": page.close_code}


@contextmanager
def running_page(worlds: Sequence[Path], place: Path = Path(WORLDS)) -> Iterator[RunningPage]:
    ready, ended = threading.Event(), threading.Event()
    made: list[RunningPage] = []

    async def run() -> None:
        session, guard = Session(worlds, place), Guard("127.0.0.1")
        server = AppServer(session, guard)
        made.append(RunningPage(session, guard, server.start("127.0.0.1", 0)))
        ready.set()
        while not ended.is_set():
            await asyncio.sleep(0.01)
        await server.stop()

    thread = threading.Thread(target=asyncio.run, args=(run(),))
    thread.start()
    try:
        assert ready.wait(20)
        yield made[0]
    finally:
        ended.set()
        thread.join(30)
