"""The WebSocket of a page: what it asks to be done, how far that is, and what came out.

The page sends `{"id": 7, "do": "fly", "world": "w0", "request": {…}}` and gets `{"id": 7, "share": 0.4, "what": …}` as
often as it reads, `{"id": 7, "ready": {…}}` when a mission can be played, and then `{"id": 7, "done": {…}}` or
`{"id": 7, "error": "…"}`. `{"id": 7, "do": "cancel"}` ends a task; a mission that is ready stays, and is `done` without
the images that were not drawn yet. Of the frames that a page requests, only the latest waits, to be rendered or to be
sent; `{"id": 7, "cancelled": true}` answers the one before it. A flight or a drive by hand reports
`{"id": 7, "live": {…}}` ten times a second, as often as the page reads, with all that is new since, and takes
`{"id": 7, "do": "steer", "stick": {…}}`, the latest first. A page that goes away ends all of its tasks.
"""

import asyncio
import json
import traceback
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from tornado.websocket import WebSocketClosedError, WebSocketHandler

from pavetwin.app.guard import Guard
from pavetwin.app.handlers import check_request
from pavetwin.app.requests import StickRequest
from pavetwin.app.session import BY_HAND, Session
from pavetwin.app.task_pool import Messages
from pavetwin.app.task_process import failure_words
from pavetwin.errors import PaveTwinError

LARGEST_MESSAGE: Final = 1 << 17
"""Bytes that a page may send at once."""

TASKS: Final = 4
"""Tasks of one page at a time, frames aside."""

FRAME: Final = "frame"

FLOWN: Final = ("fly", "fly_missed")
FLIGHTS: Final = (*FLOWN, "play", *BY_HAND)
"""Tasks that a page has one of at a time."""

UNREAD: Final = 1 << 22
"""Bytes that may wait for a page; one that reads so late is closed."""

PAGES: Final = 64
"""Open at a time."""


def joined(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two states of a flight or drive by hand: the later, with the additions of both.

    Columns of captures and lists of defects grow; a flag stays where either has it.
    """
    grown = {**before, **after}
    for name, value in before.items():
        now = after.get(name)
        if isinstance(value, dict) and name == "captures" and isinstance(now, dict):
            grown[name] = {column: [*values, *now[column]] for column, values in value.items()}
        elif isinstance(value, list) and name == "found" and isinstance(now, list):
            grown[name] = [*value, *now]
        elif isinstance(value, bool) and isinstance(now, bool):
            grown[name] = value or now
    return grown


class LiveHandler(WebSocketHandler):
    """One page."""

    needs_token = True
    open_pages = 0

    def initialize(self, session: Session, guard: Guard) -> None:
        self.session, self.guard = session, guard
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._frames: set[int] = set()
        self._unsent: set[int] = set()
        """Frames that wait until the page has read what it was sent before."""
        self._flight: int | None = None
        """The flight that is going on, until it is ready."""
        self._ready: dict[int, Mapping[str, Any]] = {}
        """Missions whose images are being drawn."""
        self._unread = 0
        self._messages: dict[int, Messages] = {}
        self._held_live: dict[int, dict[str, Any]] = {}
        """Unsent states of flights and drives by hand."""
        self._leaving: asyncio.Task[None] | None = None
        self._sending: asyncio.Future[None] | None = None
        self._is_open = False

    def prepare(self) -> None:
        check_request(self)

    def check_origin(self, origin: str) -> bool:
        return self.guard.is_origin(origin, self.request.host)

    def open(self, *_: str, **__: str) -> None:
        if LiveHandler.open_pages >= PAGES:
            self.close(1013, "Too many pages are open.")
            return
        LiveHandler.open_pages += 1
        self._is_open = True
        self.session.frames.enter(self)

    def on_close(self) -> None:
        if self._is_open:
            LiveHandler.open_pages -= 1
            self._is_open = False
        for task in self._tasks.values():
            task.cancel()
        self._leaving = asyncio.create_task(self.session.frames.leave(self))

    def on_message(self, message: str | bytes) -> None:
        try:
            asked = json.loads(message)
            number = asked["id"]
            if not isinstance(number, int) or isinstance(number, bool):
                raise TypeError
        except (ValueError, KeyError, TypeError, RecursionError):
            self.close(1003, "A message is an object with a whole number as its id.")
            return
        if asked.get("do") == "cancel":
            if task := self._tasks.get(number):
                task.cancel()
        elif asked.get("do") == "steer":
            self._say(number, asked.get("stick"))
        elif words := self._refusal(number, asked.get("do")):
            self._send({"id": number, "error": words})
        else:
            self._begin(number, asked)

    def _refusal(self, number: int, do: Any) -> str | None:
        """Why a task is not begun."""
        if number in self._tasks or (do != FRAME and len(self._tasks.keys() - self._frames) >= TASKS):
            return "Too much is being done already; wait for it, or cancel it."
        if do in FLIGHTS and self._flight is not None:
            return "This page has a flight that is going on; wait for it, or cancel it."
        return None

    def _begin(self, number: int, asked: dict[str, Any]) -> None:
        if asked.get("do") == FRAME:
            for before in self._unsent:
                self._tasks[before].cancel()
            self._frames.add(number)
        elif asked.get("do") in FLIGHTS:
            self._flight = number
        self._tasks[number] = asyncio.create_task(self._do(number, asked))

    def _say(self, number: int, values: Any) -> None:
        """Pass on what a pilot does; too late where the flight is over."""
        try:
            stick = StickRequest.of(values)
        except PaveTwinError as error:
            self.close(1003, str(error)[:100])
            return
        if messages := self._messages.get(number):
            messages.send(stick.model_dump())

    async def _do(self, number: int, asked: dict[str, Any]) -> None:
        try:
            self._send({"id": number, **await self._answer(number, asked)})
        finally:
            del self._tasks[number]
            self._messages.pop(number, None)
            self._held_live.pop(number, None)
            self._ready.pop(number, None)
            self._frames.discard(number)
            if self._flight == number:
                self._flight = None

    async def _answer(self, number: int, asked: dict[str, Any]) -> dict[str, Any]:
        """The last message of a task."""
        try:
            if asked.get("do") == FRAME:
                return {"done": await self._frame(number, asked)}
            messages = self._messages[number] = Messages()
            done = await self.session.run(asked, lambda report: self._report(number, report, asked.get("do")), messages)
        except asyncio.CancelledError:
            return {"done": self._ready[number]} if number in self._ready else {"cancelled": True}
        except Exception as error:
            if not isinstance(error, PaveTwinError):
                traceback.print_exception(error)
            return {"error": failure_words(error)}
        self._tell_live(number)
        return {"done": done}

    async def _frame(self, number: int, asked: dict[str, Any]) -> Mapping[str, Any]:
        """A frame, once the page has read all that it was sent before: frames are large."""
        frame = await self.session.frame(self, asked)
        self._unsent.add(number)
        try:
            while self._sending is not None and not self._sending.done():
                await asyncio.wait([self._sending])
        finally:
            self._unsent.discard(number)
        return frame

    def _report(self, number: int, report: Mapping[str, Any], do: Any) -> None:
        """Progress; while the page has not taken what it was sent before, it is left out, and what is live is kept."""
        if "ready" in report and do in FLOWN:
            self._ready[number] = report["ready"]
            self._flight = None
        if "live" in report:
            self._held_live[number] = joined(self._held_live.get(number, {}), report["live"])
        is_ready = self._sending is None or self._sending.done()
        if "live" in report and is_ready:
            self._tell_live(number)
        elif "ready" in report or ("live" not in report and is_ready):
            self._send({"id": number, **report})

    def _tell_live(self, number: int) -> None:
        if live := self._held_live.pop(number, None):
            self._send({"id": number, "live": live})

    def _send(self, message: dict[str, Any]) -> None:
        if self._unread > UNREAD:
            self.close(1008, "The page does not read the answers that it requests.")
            return
        text = json.dumps(message)
        with suppress(WebSocketClosedError):
            self._sending = self.write_message(text)
            self._unread += len(text)
            self._sending.add_done_callback(lambda sent: self._has_read(len(text), sent))

    def _has_read(self, count: int, sent: asyncio.Future[None]) -> None:
        self._unread -= count
        sent.cancelled() or sent.exception()  # the page may have gone
