"""The pattern that covers the whole width."""

from collections.abc import Sequence
from math import ceil

import numpy as np

from pavetwin.config.mission import PatternSettings
from pavetwin.navigation.patterns.base import pattern


@pattern("boustrophedon")
def boustrophedon(left_m: float, right_m: float, window_m: float, settings: PatternSettings) -> Sequence[float]:
    """As many parallel passes as the window's width and the side overlap need, at least one, evenly spaced."""
    spare_m = left_m + right_m - window_m
    if spare_m <= 0:
        return [(left_m - right_m) / 2]
    count = ceil(spare_m / (window_m * (1 - settings.side_overlap)) - 1e-9) + 1
    return list(np.linspace(window_m / 2 - right_m, left_m - window_m / 2, count))
