"""This process alone, or a pool of processes on this machine."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from pavetwin.experiments.engines.base import DIED, Engine, Listener, in_batches
from pavetwin.experiments.fly_unit import failed_unit, fly_unit
from pavetwin.experiments.plan import Plan, Unit
from pavetwin.traffic.runner import keep_process
from pavetwin.workers import OnTick, WaitingProcess, WorkerPool, started


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
