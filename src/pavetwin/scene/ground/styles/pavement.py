"""A pavement: what a carriageway is made of, how it looks new and old, and what is repaired on it. A YAML file each."""

from enum import StrEnum
from functools import cache
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from pavetwin.config.named import read_named
from pavetwin.config.settings import NUMBER, PlacedValueError, Settings, Share, Title
from pavetwin.scene.ground.styles.values import ValueRange, Within
from pavetwin.scene.values import GroundKind

PACKAGE: Final = "pavetwin.scene.ground.styles"

Reflectance = Annotated[float, Field(ge=0.02, le=0.5), NUMBER]
Factor = Annotated[float, Field(ge=0, le=5), NUMBER]
ColourFactor = Annotated[float, Field(ge=0.6, le=1.4), NUMBER]


class Material(StrEnum):
    """Detail textures of carriageways."""

    ASPHALT = "asphalt"
    CHIP_SEAL = "chip_seal"
    CONCRETE = "concrete"

    @property
    def ground(self) -> GroundKind:
        return _GROUND[self]


_GROUND: Final = {
    Material.ASPHALT: GroundKind.ASPHALT,
    Material.CHIP_SEAL: GroundKind.CHIP_SEAL,
    Material.CONCRETE: GroundKind.SLABS,
}


class SurfaceReflectance(Settings):
    """Mean reflectance over visible light: ρ(a) = new + (aged − new) · a^0.6 at the age a, 0 … 1."""

    new: Reflectance
    """Reflectance at age 0."""
    aged: Reflectance
    """Reflectance at age 1."""
    spread: Annotated[float, Field(ge=0, le=0.5), NUMBER] = 0.08
    """Relative difference between streets of one age, at most."""

    def at(self, age: float, chance: float) -> float:
        """At an age, with a random number 0 … 1 for the difference between streets."""
        return float((self.new + (self.aged - self.new) * age**0.6) * (1 + self.spread * (2 * chance - 1)))


class Tint(Settings):
    """Colour of the aggregate and the binder, as factors on a neutral grey of the same brightness."""

    red: ColourFactor = 1.0
    """Factor on red."""
    blue: ColourFactor = 1.0
    """Factor on blue."""
    spread: Annotated[float, Field(ge=0, le=0.2), NUMBER] = 0.03
    """Difference between streets, at most: redder and less blue, or the reverse."""

    def at(self, chance: float) -> tuple[float, float]:
        """Factors on red and blue for a random number 0 … 1."""
        warmth = self.spread * (2 * chance - 1)
        return self.red * (1 + warmth), self.blue * (1 - warmth)


class RepairRates(Settings):
    """How often it is repaired, × the rates of dense asphalt of the same age (`distractors.repairs`)."""

    patches: Factor = 1.0
    """Cut-out rectangles."""
    trenches: Factor = 1.0
    """Strips over pipes and cables."""
    sealed_cracks: Factor = 1.0
    """Lines of bitumen."""
    joint_share: Share = 0.35
    """Share of the streets whose paver joint is sealed."""


class Slabs(Settings):
    """Joints between slabs, filled with a dark sealant."""

    every_m: Annotated[float, Field(ge=1, le=30), NUMBER]
    """Distance between joints across the carriageway."""
    half_width_m: Annotated[float, Field(ge=0.012, le=0.03), NUMBER] = 0.015
    """Half the width of the sealant and its overband; finer lines alias on the maps."""
    lost: Share = 0.03
    """Share of the sealant that is missing."""
    expansion_every: Annotated[int, Field(ge=2, le=100), NUMBER] | None = None
    """Number of joints across per expansion joint; no expansion joints without it."""
    expansion_half_width_m: Annotated[float, Field(ge=0.012, le=0.06), NUMBER] = 0.028
    """Half the width of an expansion joint."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.expansion_every is None and "expansion_half_width_m" in self.model_fields_set:
            raise PlacedValueError(("expansion_half_width_m",), "no joint is an expansion joint; give expansion_every")
        return self


class Pavement(Settings):
    """A pavement."""

    title: Title
    """Name in messages."""
    material: Material
    """Detail texture."""
    reflectance: SurfaceReflectance
    """Mean reflectance of visible light at age a (0 … 1): new + (aged − new) · a^0.6."""
    tint: Tint = Tint()
    """Colour of aggregate and binder, as factors on a neutral grey of the same brightness."""
    age: Annotated[ValueRange, Within(0.0, 1.0)] = ValueRange(least=0.0, most=1.0)
    """Age of its streets: 0 newly paved, 1 due for renewal."""
    grain: Annotated[ValueRange, Within(0.0, 1.9)] = ValueRange(least=0.5, most=1.0)
    """Contrast of the stones relative to clean new ones."""
    wheel_paths: Annotated[ValueRange, Within(-0.5, 0.5)] = ValueRange(least=-0.065, most=0.075)
    """Relative change of the reflectance in wheel paths: polished stones are paler, bleeding binder is darker."""
    streaks: Factor = 1.0
    """Contrast of the streaks along the street left by paver, rollers and tyres."""
    blotches: Factor = 1.0
    """Contrast of the slow changes of tone over metres."""
    oil: Factor = 1.0
    """Strength of the oil band in the middle of lanes."""
    repairs: RepairRates = RepairRates()
    """Repair rates relative to dense asphalt of the same age."""
    slabs: Slabs | None = None
    """Sealed joints between concrete slabs; a surface without joints otherwise."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.slabs is not None and self.material is not Material.CONCRETE:
            raise PlacedValueError(("slabs",), f"only concrete has slabs, and the material is {self.material.value}")
        return self


@cache
def pavement(name: str) -> Pavement:
    """The pavement of a name, or of a YAML file of the user's own.

    Raises:
        PaveTwinError: there is no such pavement or file, or the file is none.
    """
    return read_named(Pavement, name, what="pavement", key="pavements", package=PACKAGE, folder="pavements")
