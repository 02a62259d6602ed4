"""Numbers in configuration: bounded, and no `yes`, `on` or `true`, which pydantic would read as 1."""

from collections.abc import Mapping
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BeforeValidator, Field


def _no_switch(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError("it must be a number")
    return value


NUMBER: Final = BeforeValidator(_no_switch)
"""Comes after the bounds of a number, so that its schema still has them."""

Number = Annotated[float, NUMBER]
Positive = Annotated[float, Field(gt=0), NUMBER]
NonNegative = Annotated[float, Field(ge=0), NUMBER]
Share = Annotated[float, Field(ge=0, le=1), NUMBER]

Weight = Annotated[float, Field(ge=0, le=1e6), NUMBER]
"""A relative frequency."""


def _some(weights: Mapping[Any, float]) -> Mapping[Any, float]:
    if not sum(weights.values()) > 0:
        raise ValueError("the weights sum to 0")
    return weights


SOME: Final = AfterValidator(_some)
"""Of a table of weights: at least one is above 0."""

Title = Annotated[str, Field(min_length=1)]

Weights = Annotated[Mapping[str, Weight], Field(min_length=1), SOME]
"""Names with their relative frequencies."""
