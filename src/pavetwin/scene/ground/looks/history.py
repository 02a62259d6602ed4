"""What is left of a street's past: repairs of other materials than its own, and markings of an earlier layout."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Final

from pydantic import Field

from pavetwin.config.base import Settings
from pavetwin.config.numbers import NUMBER, SOME, Share, Weight, Weights
from pavetwin.scene.ground.looks.values import ValueRange, Within

OWN: Final = "own"
"""The pavement of the street itself."""


Per100M = Annotated[float, Field(ge=0, le=50), NUMBER]


class RepairMaterials(Settings):
    """What repairs are made of: pavements by name, or by a file beside the look, with their relative frequencies."""

    patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Rectangles that were cut out; `own` is the street's pavement, newer and darker or older and paler."""
    trenches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Strips over pipes and cables, along and across."""
    connections: Share = 0.0
    """Of trenches along a street that have others to the kerb, where houses are connected."""
    renewed: Share = 0.0
    """Of patches with a later one that covers a part of them."""
    cold_patches: Weights = Field(default_factory=lambda: {OWN: 1.0})
    """Patches that were thrown into holes without cutting, with irregular outlines."""
    cold_patches_per_100_m: Per100M = 0.0
    """On a street of age 1; fewer on newer ones."""

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
    """Of marked streets, and of crossings, that have some."""
    kinds: Annotated[Mapping[FormerKind, Weight], Field(min_length=1), SOME] = Field(
        default_factory=lambda: dict.fromkeys(FormerKind, 1.0)
    )
    wear: Annotated[ValueRange, Within(0.0, 0.98)] = ValueRange(least=0.7, most=0.93)
    """Of paint that was left."""
    beside_m: Annotated[ValueRange, Within(0.0, 0.3)] = ValueRange(least=0.03, most=0.12)
    """From lines to those that were painted over them."""
    moved_m: Annotated[ValueRange, Within(0.0, 3.0)] = ValueRange(least=0.25, most=0.8)
    """From lines to those of today's layout otherwise."""
    removed_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.84, most=1.16)
    masked_tone: Annotated[ValueRange, Within(0.3, 1.8)] = ValueRange(least=0.5, most=0.72)
    """Factors on the reflectance of the pavement."""
