"""How old a street's surface is, and what follows from it."""

from dataclasses import dataclass
from typing import Final

FRESH_SHARE: Final = 0.12
"""Streets laid lately."""


@dataclass(frozen=True)
class Ageing:
    """A street's age in numbers."""

    age: float
    """0 just laid … 1 due for renewal."""
    tone: float
    """Of its reflectance, × the grain's own."""
    paint_wear: float
    """Of its markings away from wheel paths, 0 … 1."""
    unpainted: bool
    """Laid so lately that nobody has marked it yet."""

    @property
    def cracked(self) -> float:
        """How much of it has been sealed and mended, 0 … 1."""
        return float(self.age**1.6)


def ageing(chances: tuple[float, float, float, float]) -> Ageing:
    """From four chances, 0 … 1 each.

    Reflectance rises as the bitumen's film wears off the stones: quickly in the first years, then slowly (Li, Harvey,
    Kendall 2013: 0.05 when laid, 0.10 to 0.15 after some years).
    """
    fresh, age, tone, paint = chances
    years = 0.05 + 0.15 * age if fresh < FRESH_SHARE else 0.25 + 0.75 * age
    level = 0.58 + 0.82 * years**0.6
    return Ageing(
        age=years,
        tone=level * (0.92 + 0.16 * tone),
        paint_wear=0.02 + 0.50 * years**1.4 * (0.4 + 0.9 * paint),
        unpainted=years < 0.1 and paint < 0.2,
    )
