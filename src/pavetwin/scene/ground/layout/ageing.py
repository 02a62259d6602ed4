"""Age of a street's surface, and what depends on it."""

from dataclasses import dataclass

from pavetwin.scene.ground.looks import Pavement


@dataclass(frozen=True)
class Ageing:
    """Surface properties that depend on a street's age."""

    age: float
    """0 newly paved … 1 due for renewal."""
    reflectance: float
    """Mean over visible light."""
    paint_wear: float
    """Wear of its markings away from wheel paths, 0 … 1."""
    unpainted: bool
    """Paved so recently that it has no markings yet."""

    @property
    def cracked(self) -> float:
        """Density of sealed cracks and repairs, 0 … 1."""
        return float(self.age**1.6)


def ageing(pavement: Pavement, chances: tuple[float, float, float], wear: float = 1.0) -> Ageing:
    """From three random numbers, 0 … 1 each: for age, reflectance and paint; `wear`: factor on that of paint."""
    age, tone, paint = chances
    years = pavement.age.at(age)
    return Ageing(
        age=years,
        reflectance=pavement.reflectance.at(years, tone),
        paint_wear=min(0.9, wear * (0.02 + 0.50 * years**1.4 * (0.4 + 0.9 * paint))),
        unpainted=years < 0.1 and paint < 0.2,
    )
