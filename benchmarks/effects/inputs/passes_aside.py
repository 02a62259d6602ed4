"""A plugin: the boustrophedon with every pass a metre and a half to the left, as where the position is off by so much.

The UAV believes that it is in place. One side of the carriageway comes nearer to the rim of the window or leaves it.
"""

from collections.abc import Sequence

from pavetwin.config.mission import PatternSettings
from pavetwin.navigation.patterns import PATTERNS, pattern

ASIDE_M = 1.5


@pattern("boustrophedon_aside")
def boustrophedon_aside(left_m: float, right_m: float, window_m: float, settings: PatternSettings) -> Sequence[float]:
    """The offsets of the boustrophedon, each `ASIDE_M` more."""
    return [offset + ASIDE_M for offset in PATTERNS.get("boustrophedon")(left_m, right_m, window_m, settings)]
