"""Level of service: how well traffic flows, by the share of the free-flow speed that it keeps.

The classes are those of the Highway Capacity Manual (HCM, 6th edition, chapters 16 and 18) for motor vehicles on urban
streets, by travel speed over base free-flow speed. The edition of 2010 has 85 % instead of 80 % for A.
"""

from enum import StrEnum
from typing import Final

from pavetwin.errors import PaveTwinError, no_such


class LevelOfService(StrEnum):
    A = "A"
    B = "B"
    C = "C"
    D = "D"
    E = "E"
    F = "F"

    @property
    def above(self) -> float:
        """The speed ratio is above this."""
        return _ABOVE[self]

    @property
    def up_to(self) -> float:
        """The speed ratio is at most this; infinite for A, since drivers may exceed the limit."""
        better = list(LevelOfService)[: list(LevelOfService).index(self)]
        return better[-1].above if better else float("inf")

    def holds(self, ratio: float) -> bool:
        return self.above < ratio <= self.up_to

    def target(self, reachable: float) -> float:
        """The speed ratio in the middle of the class, or of the part of it that a network can reach; in F above it.

        Args:
            reachable: the speed ratio of the nearly empty network.
        """
        share = STOP_AND_GO if self is LevelOfService.F else 0.5
        return self.above + share * (min(self.up_to, reachable, 1.0) - self.above)


STOP_AND_GO: Final = 2 / 3
"""Where the target of F is, which ends at standstill. At its middle, a speed ratio of 0.15, traffic falls into gridlock
in some towns, and no number of vehicles holds it."""

_ABOVE: Final = {"A": 0.80, "B": 0.67, "C": 0.50, "D": 0.40, "E": 0.30, "F": 0.0}


def level_of(ratio: float) -> LevelOfService:
    """The class of a speed ratio, 0 … 1 and above. Standing traffic is F."""
    return next((level for level in LevelOfService if ratio > level.above), LevelOfService.F)


def level_named(name: str) -> LevelOfService:
    """Raises:
    PaveTwinError: there is no such class.
    """
    if name.upper() not in LevelOfService.__members__:
        raise PaveTwinError(no_such("level of service", name, LevelOfService, key="`los`"))
    return LevelOfService(name.upper())
