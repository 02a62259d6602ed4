"""Rendered frames of captures in the server: made one at a time by a process that stays, the latest
ones kept."""

import asyncio
import json
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, Final

from pavetwin.app.requests import FramePart
from pavetwin.app.task_pool import KeptProcess, Messages

KEPT: Final = 160
"""Frames in memory; each is below about 150 kB."""


class FrameRenderer:
    """Renders one frame at a time in a process that is there while a page is open: the one that makes the tiles of the
    town in 3-D, of the same world.

    Of each page only its latest request counts: moving the slider requests many frames, and all but the last are of no
    use any more. One that waits is dropped, one that is rendered is given up unless it is a preview, which takes no
    longer than giving it up. Pages take turns.
    """

    def __init__(self, process: KeptProcess) -> None:
        self._process = process
        self._pages: set[object] = set()
        self._waiting: dict[object, tuple[Mapping[str, Any], asyncio.Future[Mapping[str, Any]]]] = {}
        self._running: asyncio.Task[None] | None = None
        self._rendered: tuple[object, Messages] | None = None
        """Page whose cancellable frame is being rendered, and the channel to cancel it."""
        self._kept: OrderedDict[str, Mapping[str, Any]] = OrderedDict()

    async def frame(self, page: object, task: Mapping[str, Any]) -> Mapping[str, Any]:
        """Raises:
        PaveTwinError: the frame cannot be rendered.
        asyncio.CancelledError: the page requested another one, or disconnected.
        """
        self._drop(page)
        if known := self._kept.get(_name(task)):
            self._kept.move_to_end(_name(task))
            return known
        self._pages.add(page)
        rendered: asyncio.Future[Mapping[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[page] = (task, rendered)
        if self._running is None or self._running.done():
            self._running = asyncio.create_task(self._render())
        return await rendered

    def _drop(self, page: object) -> None:
        """Drop the requests of a page."""
        if waiting := self._waiting.pop(page, None):
            waiting[1].cancel()
        if self._rendered is not None and self._rendered[0] is page:
            self._rendered[1].send({"stop": True})

    async def _render(self) -> None:
        while self._waiting:
            page = next(iter(self._waiting))
            task, rendered = self._waiting.pop(page)
            if rendered.done():
                continue
            messages = Messages()
            self._rendered = None if task.get("part") == FramePart.PREVIEW else (page, messages)
            try:
                result = await self._process.run(task, messages=messages)
            except Exception as error:  # reported to the page; the next one is rendered
                if not rendered.done():
                    rendered.set_exception(error)
                continue
            finally:
                self._rendered = None
            if not result:
                rendered.cancel()
                continue
            self._keep(task, result)
            if not rendered.done():
                rendered.set_result(result)

    def _keep(self, task: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        self._kept[_name(task)] = result
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)

    def enter(self, page: object) -> None:
        """A page was opened."""
        self._pages.add(page)

    async def leave(self, page: object) -> None:
        """A page has closed: its frames are no longer rendered, and the process ends with the last page."""
        self._drop(page)
        self._pages.discard(page)
        if not self._pages:
            await self._process.end()

    async def close(self) -> None:
        """End the process, and render nothing more."""
        for page in tuple(self._pages):
            self._drop(page)
        await self._process.close()
        if self._running is not None:
            await self._running


def _name(task: Mapping[str, Any]) -> str:
    return json.dumps(task, sort_keys=True)
