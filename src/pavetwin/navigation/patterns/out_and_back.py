"""The paper's pattern: one pass over each half."""

from collections.abc import Sequence

from pavetwin.config.mission import PatternSettings
from pavetwin.navigation.patterns.base import pattern


@pattern("out_and_back")
def out_and_back(
    left_m: float,
    right_m: float,
    window_m: float,  # noqa: ARG001
    settings: PatternSettings,  # noqa: ARG001
) -> Sequence[float]:
    """One pass over the middle of each half of the carriageway (arXiv 2606.20742)."""
    return [-right_m / 2, left_m / 2]
