"""The rendered frames of captures as the server sees them: one process that renders, and the latest ones kept."""

import asyncio
import json
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, Final

from pavetwin.app.task_pool import TaskProcess
from pavetwin.errors import PaveTwinError

KEPT: Final = 160
"""Frames in memory; each is below about 150 kB."""


class FrameRenderer:
    """Renders one frame at a time in a process of its own, which is there while a page uses it.

    Of each page only its latest request waits: moving the slider asks for many frames, and all but the last are of no
    use any more. Pages take turns.
    """

    def __init__(self) -> None:
        self._process: TaskProcess | None = None
        self._starting = asyncio.Lock()
        self._pages: set[object] = set()
        self._waiting: dict[object, tuple[Mapping[str, Any], asyncio.Future[Mapping[str, Any]]]] = {}
        self._running: asyncio.Task[None] | None = None
        self._kept: OrderedDict[str, Mapping[str, Any]] = OrderedDict()
        self._is_closed = False

    async def frame(self, page: object, task: Mapping[str, Any]) -> Mapping[str, Any]:
        """Raises:
        PaveTwinError: the frame cannot be rendered.
        asyncio.CancelledError: the page asked for another one, or has gone.
        """
        self._drop(page)
        if known := self._kept.get(_name(task)):
            self._kept.move_to_end(_name(task))
            return known
        if self._is_closed:
            raise PaveTwinError("The server is ending.")
        self._pages.add(page)
        rendered: asyncio.Future[Mapping[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[page] = (task, rendered)
        if self._running is None or self._running.done():
            self._running = asyncio.create_task(self._render())
        return await rendered

    def _drop(self, page: object) -> None:
        if waiting := self._waiting.pop(page, None):
            waiting[1].cancel()

    async def _render(self) -> None:
        while self._waiting:
            page = next(iter(self._waiting))
            task, rendered = self._waiting.pop(page)
            try:
                process = None if rendered.done() else await self._started()
                if process is None or rendered.done():
                    continue
                result = await process.run(task, lambda _: None)
            except PaveTwinError as error:
                if not rendered.done():
                    rendered.set_exception(error)
                continue
            self._keep(task, result)
            if not rendered.done():
                rendered.set_result(result)

    def _keep(self, task: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        self._kept[_name(task)] = result
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)

    async def _started(self) -> TaskProcess:
        async with self._starting:
            if self._process is not None and not self._process.is_alive:
                await self._process.stop()
                self._process = None
            if self._process is None:
                self._process = await TaskProcess.start()
            return self._process

    async def leave(self, page: object) -> None:
        """A page has gone: nothing of it is rendered any more, and with the last page the process ends."""
        self._drop(page)
        self._pages.discard(page)
        async with self._starting:  # a process that is just being started is not overlooked
            if self._pages or self._process is None:
                return
            process, self._process = self._process, None
        await process.stop()

    async def close(self) -> None:
        """End the process."""
        self._is_closed = True
        for page in (*self._pages, self):
            await self.leave(page)
        if self._running is not None:
            await self._running


def _name(task: Mapping[str, Any]) -> str:
    return json.dumps(task, sort_keys=True)
