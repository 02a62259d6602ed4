"""Surfaces of one pavement, and what depends on their age."""

from dataclasses import dataclass
from typing import Final

from pavetwin.scene.ground.materials.detail_textures import CHIPS, CONCRETE_REFLECTANCE, DENSE
from pavetwin.scene.ground.styles import Pavement
from pavetwin.scene.values import PLAIN_FINISH, Finish, GroundKind


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


REFLECTANCES: Final = {
    GroundKind.ASPHALT: DENSE.reflectance,
    GroundKind.CHIP_SEAL: CHIPS.reflectance,
    GroundKind.SLABS: CONCRETE_REFLECTANCE,
}
"""Means of the detail textures of carriageways."""


@dataclass(frozen=True)
class PavedSurface:
    """A surface of one pavement and age."""

    kind: GroundKind
    finish: Finish
    shade: float = 1.0
    """Factor on the reflectance of its finish, drawn in maps, such as where lanes were paved apart."""

    @classmethod
    def of(cls, pavement: Pavement, reflectance: float, tint: float, grain: float) -> "PavedSurface":
        """A pavement of a reflectance, with random numbers 0 … 1 for its tint and its grain."""
        kind = pavement.material.ground
        factors = (*pavement.tint.at(tint), pavement.grain.at(grain), reflectance / REFLECTANCES[kind])
        return cls(kind, Finish.rounded(*factors))

    @property
    def material(self) -> tuple[GroundKind, Finish]:
        """Key by which meshes are divided."""
        return self.kind, self.finish

    @property
    def reflectance(self) -> float:
        """Mean over visible light."""
        return self.bare_reflectance * self.shade

    @property
    def bare_reflectance(self) -> float:
        """The same of its kind and finish alone, without what is drawn in maps."""
        return REFLECTANCES[self.kind] * self.finish.tone


PLAIN: Final = PavedSurface(GroundKind.ASPHALT, PLAIN_FINISH)
"""Where no street leads."""
