"""Ranges of values and relative frequencies in data files."""

from bisect import bisect
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from typing import Annotated, Any, Self, TypeVar

from pydantic import AfterValidator, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue

from pavetwin.config.settings import Number, Settings


class ValueRange(Settings):
    """Evenly from the least to the most of a value."""

    least: Number
    most: Number

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.least > self.most:
            raise ValueError(f"least {self.least:g} is larger than most {self.most:g}")
        return self

    def at(self, chance: float) -> float:
        """The value at a random number 0 … 1."""
        return self.least + (self.most - self.least) * chance


def whole(values: ValueRange) -> ValueRange:
    """Refuse a range of a count whose ends are not whole numbers.

    Raises:
        ValueError: one is none.
    """
    if not (values.least.is_integer() and values.most.is_integer()):
        raise ValueError("least and most are whole numbers")
    return values


@dataclass(frozen=True, slots=True)
class Within:
    """Bounds of a range of values."""

    low: float
    high: float

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return handler.generate_schema(Annotated[source, AfterValidator(self._checked)])

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {**handler(schema), "within": [self.low, self.high]}

    def _checked(self, values: ValueRange) -> ValueRange:
        if values.least < self.low or values.most > self.high:
            raise ValueError(f"least and most lie between {self.low:g} and {self.high:g}")
        return values


Chosen = TypeVar("Chosen")


def pick(weights: Mapping[Chosen, float], chance: float) -> Chosen:
    """One key of a table of weights, for a random number 0 … 1."""
    bounds = list(accumulate(weights.values()))
    return list(weights)[bisect(bounds, chance * bounds[-1], hi=len(bounds) - 1)]
