"""Ranges of values in data files."""

from typing import Self

from pydantic import AfterValidator, model_validator

from pavetwin.config.base import Settings
from pavetwin.config.numbers import Number


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


def within(low: float, high: float) -> AfterValidator:
    """Bounds of a range of values."""

    def checked(values: ValueRange) -> ValueRange:
        if values.least < low or values.most > high:
            raise ValueError(f"least and most lie between {low:g} and {high:g}")
        return values

    return AfterValidator(checked)
