"""The interface of an engine."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from pavetwin.experiments.plan import Plan, Unit
from pavetwin.workers import ATTEMPTS

DIED: Final = f"The process that flew it died {ATTEMPTS} times, perhaps out of memory."


@dataclass(frozen=True)
class Listener:
    """What an engine calls while it flies. An exception from `on_ready` or `on_unit` ends it."""

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
        """While it lasts, workers start that `fly` uses, before it is known what they fly."""
        return nullcontext()

    @abstractmethod
    def fly(self, plan: Plan, units: Sequence[Unit], listener: Listener) -> None:
        """Fly all units.

        Raises:
            PaveTwinError: there are no workers.
        """
