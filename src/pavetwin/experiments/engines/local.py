"""This process alone, or a pool of processes on this machine."""

import multiprocessing
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from pavetwin.experiments.engines.base import ATTEMPTS, DIED, Engine, OnStand, OnUnit, Tell, in_batches
from pavetwin.experiments.fly_unit import failed_unit, fly_unit
from pavetwin.experiments.plan import Plan, Unit
from pavetwin.processes import serve_parent


class Single(Engine):
    """One unit after the other in this process."""

    def fly(
        self,
        plan: Plan,
        units: Sequence[Unit],
        on_stand: OnStand,
        on_unit: OnUnit,
        tell: Tell,  # noqa: ARG002 - it is there at once
    ) -> None:
        on_stand()
        for unit in units:
            on_unit(unit, fly_unit(plan, unit))


class Pool(Engine):
    """As many processes as are wanted. One that dies is replaced, and what it flew is flown again."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def fly(self, plan: Plan, units: Sequence[Unit], on_stand: OnStand, on_unit: OnUnit, tell: Tell) -> None:
        tell(f"Starting {self._jobs} processes")
        on_stand()
        waiting, deaths = deque(in_batches(units, self._jobs)), Counter[Unit]()
        while waiting:
            lost = self._fly(plan, waiting, on_unit)
            # Who died is not known: one of those that were in work is to blame, the others are flown again as well.
            for unit in (unit for batch in lost for unit in batch):
                deaths[unit] += 1
                if deaths[unit] < ATTEMPTS:
                    waiting.append([unit])
                else:
                    on_unit(unit, failed_unit(plan, unit, DIED))

    def _fly(self, plan: Plan, waiting: deque[list[Unit]], on_unit: OnUnit) -> list[list[Unit]]:
        """Take batches from `waiting` until none are left, or a process died; gives the batches that this cost."""
        in_work: dict[Future[list[bytes]], list[Unit]] = {}
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(self._jobs, context, initializer=_begin, initargs=(plan,))
        try:
            while waiting or in_work:
                while waiting and len(in_work) < self._jobs:
                    batch = waiting.popleft()
                    in_work[pool.submit(_work, batch)] = batch
                for done in wait(in_work, return_when=FIRST_COMPLETED).done:
                    for unit, part in zip(in_work[done], done.result(), strict=True):
                        on_unit(unit, part)
                    del in_work[done]
        except BrokenProcessPool:
            return list(in_work.values())
        except BaseException:
            for child in multiprocessing.active_children():
                child.terminate()  # what they fly is flown again; no one should wait for it
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
        return []


# --- In another process ---------------------------------------------------------------------------------------------

_plans: list[Plan] = []
"""The plan that this process works for."""


def _begin(plan: Plan) -> None:
    serve_parent()
    _plans[:] = [plan]


def _work(batch: list[Unit]) -> list[bytes]:
    return [fly_unit(_plans[0], unit) for unit in batch]
