"""How likely an entry of an inventory shows a defect, by what is known of it without the truth.

A logistic regression: log-odds = β(class) + β(confidence) · log-odds of the confidence + β(looks) · log₂ of the images
that show it + β(size) · log₂ of its size in pixels, over `SIZE_PX`.
"""

from collections.abc import Mapping
from math import exp, log, log2
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from pavetwin.config.settings import NonNegative, Settings, Share
from pavetwin.sensing.fitted_number import FittedNumber

OF_ENTRY: Final = ("confidence", "looks", "size")
"""Variables of an entry, whose effects all classes share."""

SIZE_PX: Final = 32.0
"""Root of the area of a footprint from which sizes are counted, in pixels."""

_LEAST: Final = 0.01
"""Confidences nearer to 0 and 1 count as this near."""


def entry_values(confidence: float, looks: int, size_px: float) -> tuple[float, float, float]:
    """The variables of an entry, in the order of `OF_ENTRY`."""
    sure = min(max(confidence, _LEAST), 1.0 - _LEAST)
    return log(sure / (1.0 - sure)), log2(max(looks, 1)), log2(max(size_px, 1.0) / SIZE_PX)


class EntryModel(Settings):
    """The part of a fitted sensor that judges entries of inventories."""

    terms: Mapping[str, FittedNumber]
    """β: each class by its name, and `OF_ENTRY`."""
    entries: Annotated[int, Field(ge=1)]
    """That it was fitted to."""
    defect_share: Share
    """Of these, that show a defect."""
    severities: Mapping[str, tuple[NonNegative, NonNegative, NonNegative]]
    """By class: shares of low, medium and high among the defects of these missions."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if missing := [name for name in OF_ENTRY if name not in self.terms]:
            raise ValueError(f"`terms` lack '{missing[0]}'")
        if not 0.0 < self.defect_share < 1.0:
            raise ValueError("`defect_share` is above 0 and below 1")
        if set(self.severities) != set(self.terms) - set(OF_ENTRY):
            raise ValueError("`severities` are those of the classes in `terms`")
        if any(sum(shares) <= 0 for shares in self.severities.values()):
            raise ValueError("`severities` of a class have a sum above 0")
        return self

    def chance(self, kind: str, confidence: float, looks: int, size_px: float) -> float | None:
        """The probability that an entry shows a defect; None for a class that it was not fitted to.

        Args:
            kind: class of the defect, such as `pothole`.
            looks: how many images show it.
            size_px: root of the area of its footprint, in pixels.
        """
        if kind not in self.severities:
            return None
        values = entry_values(confidence, looks, size_px)
        score = self.terms[kind].estimate
        score += sum(self.terms[name].estimate * value for name, value in zip(OF_ENTRY, values, strict=True))
        return 1.0 / (1.0 + exp(-min(max(score, -30.0), 30.0)))
