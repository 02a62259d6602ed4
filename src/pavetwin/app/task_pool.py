"""The task processes as the server sees them: started ahead, used again, ended with all that they started."""

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, Final

from pavetwin.app.task_process import GRACE_S
from pavetwin.errors import PaveTwinError

RUNNING: Final = 3
"""Tasks at a time; more wait."""

IDLE: Final = 2
"""Processes that are kept for the next tasks, with the world that they have read."""

_LINE: Final = 1 << 22
"""Longest reply in bytes: what is larger goes into files."""

OnReport = Callable[[Mapping[str, Any]], None]
"""Told `share` and `what`, or what is `ready` while the task goes on."""


class TaskProcess:
    """One process, which runs one task at a time."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def start(cls) -> "TaskProcess":
        return cls(
            await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "pavetwin.app.task_process"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LINE,
                start_new_session=True,
            )
        )

    @property
    def id(self) -> int:
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        assert self._process.stdout is not None
        return self._process.returncode is None and not self._process.stdout.at_eof()

    async def run(self, task: Mapping[str, Any], on_progress: OnReport) -> Mapping[str, Any]:
        """Raises:
        PaveTwinError: the task cannot be done, or its process died.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        died = "The process that did this has died; perhaps the memory was used up. Try it with less."
        try:
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            await self._process.stdin.drain()
        except ConnectionError as error:
            raise PaveTwinError(died) from error
        while line := await self._process.stdout.readline():
            reply = json.loads(line)
            if "error" in reply:
                raise PaveTwinError(reply["error"])
            if "result" in reply:
                result: Mapping[str, Any] = reply["result"]
                return result
            on_progress(reply)
        raise PaveTwinError(died)

    async def stop(self) -> None:
        """End it and all that it started; by force where it takes longer than its time to clear up."""
        if self.is_alive:
            with suppress(ProcessLookupError):
                self._process.terminate()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._process.wait(), GRACE_S)
        with suppress(ProcessLookupError):
            os.killpg(self.id, signal.SIGKILL)  # also what outlived it
        await self._process.wait()


class TaskPool:
    """Up to `RUNNING` tasks at a time. A task that is cancelled ends its process."""

    def __init__(self) -> None:
        self._free = asyncio.Semaphore(RUNNING)
        self._idle: list[TaskProcess] = []
        self._all: set[TaskProcess] = set()
        self._is_closed = False

    async def run(self, task: Mapping[str, Any], on_progress: OnReport = lambda _: None) -> Mapping[str, Any]:
        """Run a task in a process, once there is one.

        Raises:
            PaveTwinError: as `TaskProcess.run`.
        """
        if self._free.locked():
            on_progress({"share": 0.0, "what": "Waiting for other tasks"})
        async with self._free, self._process() as process:
            return await process.run(task, on_progress)

    async def warm_up(self) -> None:
        """Start a process, so that the first task need not wait for what it loads."""
        if not self._idle and not self._is_closed:
            self._idle.append(await self._started())

    @asynccontextmanager
    async def _process(self) -> AsyncIterator[TaskProcess]:
        process = self._idle.pop() if self._idle else await self._started()
        try:
            yield process
        except PaveTwinError:
            await self._give_back(process)
            raise
        except BaseException:
            await asyncio.shield(self._end(process))
            raise
        await self._give_back(process)

    async def _started(self) -> TaskProcess:
        process = await TaskProcess.start()
        self._all.add(process)
        return process

    async def _give_back(self, process: TaskProcess) -> None:
        if process.is_alive and len(self._idle) < IDLE and not self._is_closed:
            self._idle.append(process)
        else:
            await self._end(process)

    async def _end(self, process: TaskProcess) -> None:
        await process.stop()
        self._all.discard(process)

    async def close(self) -> None:
        """End all processes."""
        self._is_closed = True
        self._idle.clear()
        await asyncio.gather(*(self._end(process) for process in tuple(self._all)))


class KeptProcess:
    """A process that stays, for short tasks one after the other: what it has read serves the next. It starts with the
    first task, and another takes its place where it died."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._process: TaskProcess | None = None
        self._is_closed = False

    async def run(self, task: Mapping[str, Any]) -> Mapping[str, Any]:
        """Run a task in its turn.

        Raises:
            PaveTwinError: as `TaskProcess.run`, or the server ends.
        """
        async with self._turn:
            if self._process is not None and not self._process.is_alive:
                await self._process.stop()
                self._process = None
            if self._process is None and not self._is_closed:
                self._process = await TaskProcess.start()
            if self._process is None or self._is_closed:
                raise PaveTwinError("The server ends.")
            return await self._process.run(task, lambda _: None)

    async def close(self) -> None:
        """End the process; tasks that wait for their turn are refused."""
        self._is_closed = True
        if self._process is not None:
            await self._process.stop()
        async with self._turn:  # a process that was just being started
            if self._process is not None:
                await self._process.stop()
