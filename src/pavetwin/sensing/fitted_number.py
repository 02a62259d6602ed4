"""A number that was fitted."""

from pavetwin.config.base import Settings
from pavetwin.config.numbers import NonNegative


class FittedNumber(Settings):
    """A number that was fitted, with its standard error."""

    estimate: float
    standard_error: NonNegative
