"""What sidewalks are paved with."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field

from pavetwin.config.settings import SOME, Settings, Share, Weight
from pavetwin.scene.ground.looks.values import ValueRange, Within
from pavetwin.scene.ground.looks.weights import pick
from pavetwin.scene.model import Finish, GroundKind


class SidewalkPaving(StrEnum):
    """Detail textures of sidewalks."""

    SLABS = "slabs"
    """Of concrete, 400 mm."""
    CONCRETE = "concrete"
    """Poured, with joints every 2 m."""
    BLOCKS = "blocks"
    """Bricks or concrete blocks in herringbone bond."""
    TILES = "tiles"
    """Of concrete, 250 mm, with grooves."""
    SETTS = "setts"
    """Of granite, in courses."""

    @property
    def ground(self) -> GroundKind:
        return _GROUND[self]


_GROUND: Final = {
    SidewalkPaving.SLABS: GroundKind.PAVING,
    SidewalkPaving.CONCRETE: GroundKind.CONCRETE,
    SidewalkPaving.BLOCKS: GroundKind.BLOCKS,
    SidewalkPaving.TILES: GroundKind.TILES,
    SidewalkPaving.SETTS: GroundKind.SETTS,
}

COLOURED: Final = frozenset({SidewalkPaving.BLOCKS, SidewalkPaving.TILES})
"""Made with iron oxide or of clay in some streets."""

RED: Final = (1.38, 0.66)
"""Factors on red and blue of pieces of clay or iron oxide; ours, after photographs from drones."""

RED_TONE: Final = 0.8
"""Factor on their reflectance."""


class SidewalkLook(Settings):
    """What sidewalks are paved with, street by street."""

    pavings: Annotated[Mapping[SidewalkPaving, Weight], Field(min_length=1), SOME] = {SidewalkPaving.SLABS: 1}
    """Concrete slabs (400 mm), poured concrete, blocks in herringbone bond, grooved tiles (250 mm), granite setts."""
    red: Share = 0.0
    """Share of the streets with blocks or tiles whose paving is red."""
    tone: Annotated[ValueRange, Within(0.4, 1.6)] = ValueRange(least=1.0, most=1.0)
    """Reflectance relative to the mean of the paving."""

    def surface(self, *, paving: float, colour: float, tone: float) -> tuple[GroundKind, Finish]:
        """What a street's sidewalks are made of, for three random numbers 0 … 1."""
        found = pick(self.pavings, paving)
        red = found in COLOURED and colour < self.red
        factors = (*(RED if red else (1.0, 1.0)), 1.0, self.tone.at(tone) * (RED_TONE if red else 1.0))
        return found.ground, Finish.rounded(*factors)
