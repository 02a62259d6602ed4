"""What is left of a street's past: repairs of other materials than its own, and markings of an earlier layout."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field

from pavetwin.config.settings import NUMBER, SOME, Settings, Share, Weight, Weights
from pavetwin.scene.ground.looks.values import ValueRange, Within

OWN: Final = "own"
"""The pavement of the street itself."""


Per100M = Annotated[float, Field(ge=0, le=50), NUMBER]


class RepairMaterials(Settings):
    """What repairs are made of: pavements by name, or by a file beside the look, with their relative frequencies."""

    patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of cut-out rectangles; `own` is the street's own pavement, newer and darker or older and paler."""
    trenches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of strips over pipes and cables, along and across."""
    connections: Share = 0.0
    """Share of the trenches along a street with branches to the kerb, where houses are connected."""
    renewed: Share = 0.0
    """Share of the patches partly covered by a later patch."""
    cold_patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Pavements of uncut patches with irregular outlines."""
    cold_patches_per_100_m: Per100M = 0.0
    """Number on a street of age 1; fewer on newer streets."""

    @property
    def tables(self) -> Mapping[str, Mapping[str, float]]:
        """The weights of pavements by key."""
        return {"patches": self.patches, "trenches": self.trenches, "cold_patches": self.cold_patches}


class FormerKind(StrEnum):
    """What became of the markings of an earlier layout."""

    WORN = "worn"
    """Left to wear off: a ghost beside today's."""
    OVERPAINTED = "overpainted"
    """Painted again some centimetres beside."""
    REMOVED = "removed"
    """Ground or blasted off: a scar in the pavement."""
    MASKED = "masked"
    """Covered with dark paint."""


class FormerMarkings(Settings):
    """Markings of an earlier layout that still show."""

    share: Share = 0.0
    """Share of the marked streets and crossings that have them."""
    kinds: Annotated[Mapping[FormerKind, Weight], Field(min_length=1), SOME] = Field(
        default_factory=lambda: dict.fromkeys(FormerKind, 1.0)
    )
    """Treatment: left to wear, repainted alongside, ground off, or covered with dark paint."""
    wear: Annotated[ValueRange, Within(0.0, 0.98)] = ValueRange(least=0.7, most=0.93)
    """Wear of paint that was left: 0 new, 1 gone."""
    beside_m: Annotated[ValueRange, Within(0.0, 0.3)] = ValueRange(least=0.03, most=0.12)
    """Distance of repainted lines from the old ones."""
    moved_m: Annotated[ValueRange, Within(0.0, 3.0)] = ValueRange(least=0.25, most=0.8)
    """Distance of all other old lines from today's."""
    removed_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.84, most=1.16)
    """Factor on the pavement's reflectance where markings were ground off."""
    masked_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.5, most=0.72)
    """Factor on the pavement's reflectance where markings were covered."""
