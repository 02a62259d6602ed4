"""Engines that fly the units of a study: this process, a pool of processes, or a Dask cluster."""

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import version
from itertools import groupby
from typing import Any, Final

from pavetwin.errors import PaveTwinError
from pavetwin.experiments.fly_unit import failed_unit, fly_unit
from pavetwin.experiments.units import Plan, Unit, check_worlds
from pavetwin.traffic.runner import keep_process
from pavetwin.workers import ATTEMPTS, OnTick, WaitingProcess, WorkerPool, started

DIED: Final = f"The process that flew it died {ATTEMPTS} times, perhaps out of memory."


@dataclass(frozen=True)
class Listener:
    """Callbacks of an engine. An exception from `on_ready` or `on_unit` ends it."""

    on_ready: Callable[[], None]
    """Called once the workers are ready; until then nothing is written."""

    on_unit: Callable[[Unit, bytes], None]
    """Called with each unit's part when it is complete, in any order."""

    on_wait: Callable[[str], None]
    """Called with what is waited for before the workers are ready."""

    on_recorded: Callable[[], None] = lambda: None
    """Called when the traffic of another unit is recorded, by engines that know of it."""


def in_batches(units: Sequence[Unit], workers: int) -> list[list[Unit]]:
    """Units for one process: all of a replicate, which share defects, where there are enough replicates."""
    together = [list(batch) for _, batch in groupby(units, key=lambda unit: (unit.world, unit.replicate))]
    return together if len(together) >= 2 * workers else [[unit] for unit in units]


class Engine(ABC):
    """Flies units, each once, in any order."""

    def started(self) -> AbstractContextManager[object]:
        """Context in which workers of `fly` start before their plan is known."""
        return nullcontext()

    @abstractmethod
    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        """Fly all units.

        Raises:
            PaveTwinError: there are no workers.
        """


class Single(Engine):
    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        listener.on_ready()
        for unit in units:
            listener.on_unit(unit, fly_unit(plan, unit, listener.on_recorded))


class Pool(Engine):
    """`jobs` processes. One that dies is replaced, and what it flew is flown again, unit by unit."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._waiting: list[WaitingProcess] = []

    @contextmanager
    def started(self) -> Iterator[None]:
        with started(self._jobs, fly_unit.__module__) as self._waiting:
            yield
        self._waiting = []

    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        listener.on_wait(f"Starting {self._jobs} processes")
        listener.on_ready()

        def on_result(batch: list[Unit], parts: list[bytes]) -> None:
            for unit, part in zip(batch, parts, strict=True):
                listener.on_unit(unit, part)

        def give_up(batch: list[Unit]) -> None:
            for unit in batch:
                listener.on_unit(unit, failed_unit(plan, unit, DIED))

        waiting, self._waiting = self._waiting, []
        with WorkerPool(self._jobs, partial(_start, plan), listener.on_recorded, waiting) as pool:
            pool.run(
                in_batches(units, self._jobs),
                on_result,
                remaining=lambda batch: [[unit] for unit in batch],
                give_up=give_up,
            )


def _start(plan: Plan, on_tick: OnTick) -> Callable[[list[Unit]], list[bytes]]:
    keep_process()
    return lambda batch: [fly_unit(plan, unit, on_tick) for unit in batch]


ANSWER_S: Final = 15.0
"""Timeout of a scheduler's answer, and then of its first worker's."""


class Cluster(Engine):
    """Units as tasks of Dask. When a worker dies, the scheduler gives its units to another."""

    def __init__(self, *, scheduler: str | None = None, jobs: int = 1) -> None:
        """`scheduler`: the address of one that runs (tcp://10.0.0.1:8786); else `jobs` workers are started here."""
        self._scheduler, self._jobs = scheduler, jobs

    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        dask: Any = import_module("distributed")
        scheduler = f"the Dask scheduler {self._scheduler}"
        listener.on_wait(f"Waiting for {scheduler}" if self._scheduler else f"Starting {self._jobs} Dask workers")
        with _silence(), self._client() as client:
            if not client.nthreads():
                listener.on_wait(f"Waiting for workers of {scheduler}")
            _check_workers(client, plan)
            listener.on_ready()
            workers = sum(client.nthreads().values())

            def submit(batch: list[Unit]) -> Any:
                return client.submit(_fly_batch, plan, batch, pure=False)

            futures = {submit(batch): batch for batch in in_batches(units, workers)}
            running = dask.as_completed(list(futures))
            for future in running:
                batch = futures.pop(future)
                try:
                    parts = future.result()
                except dask.KilledWorker:
                    if len(batch) == 1:
                        listener.on_unit(batch[0], failed_unit(plan, batch[0], DIED))
                        continue
                    for unit in batch:
                        futures[again := submit([unit])] = [unit]
                        running.add(again)
                    continue
                for unit, part in zip(batch, parts, strict=True):
                    listener.on_unit(unit, part)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        dask: Any = import_module("distributed")
        if self._scheduler is None:
            with (
                dask.LocalCluster(n_workers=self._jobs, threads_per_worker=1, dashboard_address=None) as local,
                dask.Client(local) as client,
            ):
                yield client
            return
        try:
            asyncio.run(_shake_hands(self._scheduler))
            client = dask.Client(self._scheduler, timeout=ANSWER_S)
        except Exception as error:  # any server may answer, and its answer is parsed as Dask's
            raise PaveTwinError(
                f"`scheduler` {self._scheduler}: no Dask scheduler answers there; start one with `dask scheduler` and "
                "workers with `dask worker tcp://…`."
            ) from error
        with client:
            try:
                yield client
            except (CancelledError, OSError, dask.client.ClosedClientError) as error:
                if client.status == "running":
                    raise
                raise PaveTwinError(
                    f"The Dask scheduler {self._scheduler} has stopped; flown missions are kept. Once one runs "
                    "again, the "
                    "same command continues."
                ) from error


async def _shake_hands(address: str) -> None:
    """Raises unless a server that speaks Dask's protocol answers: a client would wait for it without end."""
    comm: Any = import_module("distributed.comm")
    security = import_module("distributed").Security().get_connection_args("client")
    connection = await asyncio.wait_for(comm.connect(address, timeout=ANSWER_S, **security), ANSWER_S)
    await connection.close()


@contextmanager
def _silence() -> Iterator[None]:
    """Without Dask's log messages: relevant failures are reported by exceptions."""
    import_module("distributed")
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL + 1)
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _fly_batch(plan: Plan, batch: Sequence[Unit]) -> list[bytes]:
    return [fly_unit(plan, unit) for unit in batch]


def _check_workers(client: Any, plan: Plan) -> None:
    """Raises:
    PaveTwinError: there are no workers, or one has another version or other worlds.
    """
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except TimeoutError as error:
        raise PaveTwinError("The Dask scheduler has no workers; start some with `dask worker tcp://…`.") from error
    for worker, complaint in client.run(_complaint, plan, version("pavetwin")).items():
        if complaint:
            raise PaveTwinError(f"The Dask worker {worker} cannot fly this study: {complaint}")


def _complaint(plan: Plan, wanted: str) -> str:
    """A worker's fault; empty if there is none."""
    if version("pavetwin") != wanted:
        return f"it has PaveTwin {version('pavetwin')}, not {wanted}."
    try:
        check_worlds(plan)
    except PaveTwinError as error:
        return str(error)
    return ""
