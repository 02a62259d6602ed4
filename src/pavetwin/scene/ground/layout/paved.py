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

FINISH_STEP: Final = 1 / 128
"""Of factors on the device."""


@dataclass(frozen=True)
class PavedSurface:
    """A surface of one pavement and age."""

    kind: GroundKind
    tone: float
    """Factor on the reflectance of the kind's detail texture."""
    finish: Finish

    @classmethod
    def of(cls, pavement: Pavement, reflectance: float, tint: float, grain: float) -> "PavedSurface":
        """A pavement of a reflectance, with random numbers 0 … 1 for its tint and its grain."""
        kind = pavement.material.ground
        factors = (*pavement.tint.at(tint), pavement.grain.at(grain))
        finish = Finish(*(round(factor / FINISH_STEP) * FINISH_STEP for factor in factors))
        return cls(kind, reflectance / REFLECTANCES[kind], finish)

    @property
    def material(self) -> tuple[GroundKind, Finish]:
        """What meshes are divided by."""
        return self.kind, self.finish


PLAIN: Final = PavedSurface(GroundKind.ASPHALT, 1.0, PLAIN_FINISH)
"""Where no street leads."""
