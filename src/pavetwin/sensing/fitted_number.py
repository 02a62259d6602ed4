"""A number that was fitted."""

from pavetwin.config.settings import NonNegative, Settings


class FittedNumber(Settings):
    """A number that was fitted, with its standard error."""

    estimate: float
    standard_error: NonNegative
