"""The task processes as the server sees them: started ahead, used again, ended with all that they started."""

import asyncio
import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, Final

from pavetwin.app.task_process import GRACE_S, MESSAGE
from pavetwin.errors import PaveTwinError

RUNNING: Final = 3
"""Tasks at a time; more wait."""

IDLE: Final = 2
"""Processes that are kept for the next tasks, with the world that they have read."""

MESSAGE_EVERY_S: Final = 0.05
"""Least time between two messages to a task."""

_LINE: Final = 1 << 22
"""Longest reply in bytes: what is larger goes into files."""

OnReport = Callable[[Mapping[str, Any]], None]
"""Called with `share` and `what`, or with data that is `ready` while the task continues."""


class ProcessDiedError(PaveTwinError):
    """The process of a task has died."""

    def __init__(self) -> None:
        super().__init__("The process that did this has died; perhaps the memory was used up. Try it with less.")


class Messages:
    """Messages to a running task: only the latest counts."""

    def __init__(self) -> None:
        self._values: Mapping[str, Any] = {}
        self._is_new = asyncio.Event()

    @property
    def is_new(self) -> bool:
        """Whether there is a message that was not taken."""
        return self._is_new.is_set()

    def send(self, values: Mapping[str, Any]) -> None:
        self._values = values
        self._is_new.set()

    async def latest(self) -> Mapping[str, Any]:
        """Wait for a new message and return it."""
        await self._is_new.wait()
        self._is_new.clear()
        return self._values


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

    async def run(
        self, task: Mapping[str, Any], on_progress: OnReport, messages: Messages | None = None
    ) -> Mapping[str, Any]:
        """Args:
            messages: sent to the running task.

        Raises:
            PaveTwinError: the task cannot be done, or its process died.
        """
        if messages is None:
            return await self._run(task, on_progress)
        passing = asyncio.create_task(self._pass_on(messages))
        try:
            return await self._run(task, on_progress)
        finally:
            passing.cancel()
            await asyncio.gather(passing, return_exceptions=True)

    async def _pass_on(self, messages: Messages) -> None:
        assert self._process.stdin is not None
        while True:
            values = await messages.latest()
            self._process.stdin.write(json.dumps({MESSAGE: values}).encode() + b"\n")
            await self._process.stdin.drain()
            await asyncio.sleep(MESSAGE_EVERY_S)

    async def _run(self, task: Mapping[str, Any], on_progress: OnReport) -> Mapping[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(task).encode() + b"\n")
            await self._process.stdin.drain()
        except ConnectionError as error:
            raise ProcessDiedError from error
        while line := await self._process.stdout.readline():
            reply = json.loads(line)
            if "error" in reply:
                raise PaveTwinError(reply["error"])
            if "result" in reply:
                result: Mapping[str, Any] = reply["result"]
                return result
            on_progress(reply)
        raise ProcessDiedError

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
    """Up to so many tasks at a time. A task that is cancelled ends its process."""

    def __init__(self, running: int = RUNNING) -> None:
        self._free = asyncio.Semaphore(running)
        self._idle: list[TaskProcess] = []
        self._all: set[TaskProcess] = set()
        self._is_closed = False

    async def run(
        self,
        task: Mapping[str, Any],
        on_progress: OnReport = lambda _: None,
        *,
        is_alone: bool = False,
        messages: Messages | None = None,
    ) -> Mapping[str, Any]:
        """Run a task in a process, once there is one.

        Args:
            messages: sent to the running task.
            is_alone: in a process that runs nothing else, before or afterwards.

        Raises:
            PaveTwinError: as `TaskProcess.run`.
        """
        if self._free.locked():
            on_progress({"share": 0.0, "what": "Waiting for other tasks"})
        async with self._free, self._process(is_alone=is_alone) as process:
            return await process.run(task, on_progress, messages)

    async def warm_up(self) -> None:
        """Start a process, so that the first task need not wait for what it loads."""
        if not self._idle and not self._is_closed:
            self._idle.append(await self._started())

    @asynccontextmanager
    async def _process(self, *, is_alone: bool) -> AsyncIterator[TaskProcess]:
        process = self._idle.pop() if self._idle and not is_alone else await self._started()
        leave = self._end if is_alone else self._give_back
        try:
            yield process
        except PaveTwinError:
            await leave(process)
            raise
        except BaseException:
            await asyncio.shield(self._end(process))
            raise
        await leave(process)

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
    first task, and another takes its place where it died or was ended."""

    def __init__(self) -> None:
        self._turn, self._patience, self._starting = asyncio.Lock(), asyncio.Lock(), asyncio.Lock()
        self._waiting = 0
        """Tasks that wait and are not patient."""
        self._process: TaskProcess | None = None
        self._is_closed = False

    async def run(
        self,
        task: Mapping[str, Any],
        *,
        is_patient: bool = False,
        again: bool = False,
        messages: Messages | None = None,
    ) -> Mapping[str, Any]:
        """Run a task in its turn.

        Args:
            is_patient: after all that wait and are not.
            again: run it in the next process where this one is ended meanwhile.
            messages: sent to the running task.

        Raises:
            PaveTwinError: as `TaskProcess.run`, or the server ends.
        """
        async with self._in_turn(is_patient=is_patient):
            known = self._process
            process = await self._ready()
            try:
                return await self._run_in(process, task, messages)
            except ProcessDiedError:
                was_ended = process is not self._process
                if (was_ended and not again) or (not was_ended and process is not known):
                    raise
                return await self._run_in(await self._ready(), task, messages)  # or it had died unnoticed before

    @asynccontextmanager
    async def _in_turn(self, *, is_patient: bool) -> AsyncIterator[None]:
        if is_patient:
            async with self._patience:
                await self._turn.acquire()
                while self._waiting:  # those get the turn that is given up here
                    self._turn.release()
                    await asyncio.sleep(0)  # a lock whose waiters have all gone is had at once, before they are counted
                    await self._turn.acquire()
        else:
            self._waiting += 1
            try:
                await self._turn.acquire()
            finally:
                self._waiting -= 1
        try:
            yield
        finally:
            self._turn.release()

    async def _run_in(
        self, process: TaskProcess, task: Mapping[str, Any], messages: Messages | None
    ) -> Mapping[str, Any]:
        try:
            return await process.run(task, lambda _: None, messages)
        except PaveTwinError:
            raise
        except BaseException:
            await asyncio.shield(self.end())  # its answer would be taken for that of the next task
            raise

    async def _ready(self) -> TaskProcess:
        async with self._starting:
            if self._process is not None and not self._process.is_alive:
                await self._process.stop()
                self._process = None
            if self._is_closed:
                raise PaveTwinError("The server is stopping.")
            if self._process is None:
                self._process = await TaskProcess.start()
            return self._process

    async def end(self) -> None:
        """End the process, and with an error the task that it runs; the next task gets another one."""
        async with self._starting:  # a process that is just being started is not overlooked
            process, self._process = self._process, None
        if process is not None:
            await process.stop()

    async def close(self) -> None:
        """End the process; tasks that wait for their turn are refused."""
        self._is_closed = True
        await self.end()
