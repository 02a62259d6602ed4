"""What an engine is."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Final

from pavetwin.experiments.plan import Plan, Unit
from pavetwin.workers import ATTEMPTS

DIED: Final = f"The process that flew it died {ATTEMPTS} times, perhaps for want of memory."

OnStand = Callable[[], None]
"""Called once whoever flies is there; until then nothing is written."""

OnUnit = Callable[[Unit, bytes], None]
"""Given each unit's part as soon as it is there, in any order."""

Tell = Callable[[str], None]
"""Told what is waited for before that."""


def in_batches(units: Sequence[Unit], workers: int) -> list[list[Unit]]:
    """Units for one process to fly in one go: a replicate's share their ground, where there are replicates for all."""
    together = [list(batch) for _, batch in groupby(units, key=lambda unit: (unit.world, unit.replicate))]
    return together if len(together) >= 2 * workers else [[unit] for unit in units]


class Engine(ABC):
    """Flies units, each once, in any order."""

    @abstractmethod
    def fly(self, plan: Plan, units: Sequence[Unit], on_stand: OnStand, on_unit: OnUnit, tell: Tell) -> None:
        """Fly all units. An exception from `on_stand` or `on_unit` ends it.

        Raises:
            PaveTwinError: the workers cannot be had.
        """
