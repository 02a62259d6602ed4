"""Age of a street's surface, and what depends on it."""

from dataclasses import dataclass
from typing import Final

FRESH_SHARE: Final = 0.12
"""Share of recently paved streets."""


@dataclass(frozen=True)
class Ageing:
    """Surface properties that depend on a street's age."""

    age: float
    """0 newly paved … 1 due for renewal."""
    tone: float
    """Factor on the reflectance of the detail texture."""
    paint_wear: float
    """Wear of its markings away from wheel paths, 0 … 1."""
    unpainted: bool
    """Paved so recently that it has no markings yet."""

    @property
    def cracked(self) -> float:
        """Density of sealed cracks and repairs, 0 … 1."""
        return float(self.age**1.6)


def ageing(chances: tuple[float, float, float, float]) -> Ageing:
    """From four random numbers, 0 … 1 each.

    Reflectance rises as the bitumen film wears off the stones: quickly in the first years, then slowly (Li, Harvey,
    Kendall 2013: 0.05 when new, 0.10 to 0.15 after some years).
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
