"""What an engine is."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Final

from pavetwin.experiments.plan import Plan, Unit

ATTEMPTS: Final = 3
"""A unit whose worker dies this often is given up: it is the unit that kills them."""

DIED: Final = f"The process that flew it died {ATTEMPTS} times, perhaps for want of memory."

OnUnit = Callable[[Unit, bytes], None]
"""Given each unit's part as soon as it is there, in any order."""


class Engine(ABC):
    """Flies units, each once, in any order."""

    @abstractmethod
    def fly(self, plan: Plan, units: Sequence[Unit], on_unit: OnUnit) -> None:
        """Fly all units. An exception from `on_unit` ends it.

        Raises:
            PaveTwinError: the workers cannot be had.
        """
