"""A surface of one pavement and age, as meshes and maps need it."""

from dataclasses import dataclass
from typing import Final

from pavetwin.scene.ground.looks import Pavement
from pavetwin.scene.ground.materials.asphalt import CHIPS, DENSE
from pavetwin.scene.ground.materials.hardscape import CONCRETE_REFLECTANCE
from pavetwin.scene.model import PLAIN_FINISH, Finish, GroundKind

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
    """Factor on the reflectance that its finish says: drawn in maps, as where lanes were paved apart."""

    @classmethod
    def of(cls, pavement: Pavement, reflectance: float, tint: float, grain: float) -> "PavedSurface":
        """A pavement of a reflectance, with random numbers 0 … 1 for its tint and its grain."""
        kind = pavement.material.ground
        factors = (*pavement.tint.at(tint), pavement.grain.at(grain), reflectance / REFLECTANCES[kind])
        return cls(kind, Finish.rounded(*factors))

    @property
    def material(self) -> tuple[GroundKind, Finish]:
        """What meshes are divided by."""
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
