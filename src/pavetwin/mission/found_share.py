"""How far the share of defects that was found may be from the truth, few and alike as the defects of a street are.

The interval is that of Korn and Graubard (Confidence intervals for proportions with small expected number of positive
counts estimated from survey data, Survey Methodology 24, 1998): Clopper and Pearson's for as many independent defects
as would have the variance that was observed between streets,

    n_eff = p (1 − p) / v · (t(N − 1) / t(df))²,   at most the N defects that there were.

Few streets tell little of that variance v, and nothing where all defects were found. It therefore has a usual value
beside it, that of defects of one street correlated by `ALIKE`, which counts as `WEIGHT` degrees of freedom; both are
our assumptions. Where the usual variance would make the interval shorter, it is left out.

How often such intervals hold the truth in simulations stands in docs/explanation/statistics.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array

LEVEL: Final = 0.95
ALIKE: Final = 0.2
"""Correlation of what becomes of two defects of one street: traffic hides them together."""
WEIGHT: Final = 4.0
"""Degrees of freedom that the usual variance counts for."""
ASSUMED: Final = 10.0
"""Degrees of freedom of Student's t beside those observed. With only `WEIGHT` nearly all intervals held the truth."""

_TAIL: Final = (1 - LEVEL) / 2


@dataclass(frozen=True, slots=True)
class FoundShare:
    """A share of defects found, as far as it is known."""

    share: float
    low: float
    high: float
    """95 % interval of the share that endless streets like these would have."""
    defects: int
    """That it rests on."""


def found_share(found: Sequence[int], defects: Sequence[int]) -> FoundShare | None:
    """The share of all defects of some streets or segments, None where there are no defects.

    Args:
        found, defects: of each street or segment.
    """
    m = np.array([count for count in defects if count], dtype=np.float64)
    y = np.array([each for each, count in zip(found, defects, strict=True) if count], dtype=np.float64)
    total = float(m.sum())
    if not total:
        return None
    share, freedom = float(y.sum()) / total, len(m) - 1
    # Of a ratio, linearised: streets with more defects weigh more.
    variance = len(m) / freedom * float(((y - share * m) ** 2).sum()) / total**2 if freedom else 0.0
    usual = float((m * (1 + (m - 1) * ALIKE)).sum()) / total**2
    return FoundShare(share, *limits(share, variance, usual, freedom, round(total)), round(total))


def usual_of_street(defects: Float64Array) -> Float64Array:
    """The usual variance of the share of each street, as a multiple of p (1 − p).

    Args:
        defects: (streets,) each above 0.
    """
    return 1 / defects + (1 - 1 / defects) * ALIKE


def limits(share: float, variance: float, usual: float, freedom: int, defects: int) -> tuple[float, float]:
    """The 95 % interval of a share.

    Args:
        variance: of the estimate, as observed between streets.
        usual: the usual variance, as a multiple of p (1 − p).
        freedom: degrees of freedom of the observed one.
        defects: that it rests on.
    """
    from scipy.special import betaincinv, stdtrit  # a fifth of a second that no other part of a mission waits for

    spread = share * (1 - share)
    pooled = (freedom * variance + WEIGHT * spread * usual) / (freedom + WEIGHT)
    effective = spread / max(variance, pooled) if spread > 0 else 1 / usual
    t, normal = stdtrit(freedom + ASSUMED, 1 - _TAIL), stdtrit(max(defects - 1, 1), 1 - _TAIL)
    effective = min(effective, defects) * min(float(normal / t) ** 2, 1.0)
    hits, misses = share * effective, (1 - share) * effective
    low = float(betaincinv(hits, misses + 1, _TAIL)) if hits > 0 else 0.0
    high = float(betaincinv(hits + 1, misses, 1 - _TAIL)) if misses > 0 else 1.0
    return low, high
