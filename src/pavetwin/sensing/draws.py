"""The random numbers of sensors without images: of a defect's k-th look under a seed, always the same."""

from functools import lru_cache
from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np

from pavetwin.seeds import Stream, child

_NORMAL: Final = NormalDist()
_COMMON: Final = 0
"""Names the child of a defect's stream that all looks at it share."""
_SMALLEST: Final = 2.0**-54
"""In place of a drawn 0, which has no normal quantile."""


def look_draw(seed: int, defect: int, look: int, correlation: float) -> float:
    """Uniform in 0 … 1: a look finds its defect where this is below its chance.

    With u drawn once for the defect and e for each look, both standard normal, and the correlation ρ, it is Φ(z) of
    z = √ρ · u + √(1 − ρ) · e (a Gaussian copula): each is uniform, and any two z of a defect have the correlation ρ. It
    depends on the arguments alone.

    Args:
        defect: its id.
        look: 0 for the first attempt at it.
    """
    if not correlation:
        return _drawn(seed, defect, look)
    return _NORMAL.cdf(look_quantile(seed, defect, look, correlation))


def look_quantile(seed: int, defect: int, look: int, correlation: float) -> float:
    """The z of `look_draw`, standard normal: a look finds its defect where this is below its score, Φ⁻¹ of its
    chance."""
    known = _quantiles(seed, defect, correlation)
    while len(known) <= look:
        own = _NORMAL.inv_cdf(max(_drawn(seed, defect, len(known)), _SMALLEST))
        known.append(sqrt(correlation) * _common(seed, defect) + sqrt(1 - correlation) * own)
    return known[look]


def _drawn(seed: int, defect: int, look: int) -> float:
    generator, drawn = _noise(seed, defect)
    while len(drawn) <= look:
        drawn.append(float(generator.random()))
    return drawn[look]


@lru_cache(maxsize=8192)
def _quantiles(seed: int, defect: int, correlation: float) -> list[float]:  # noqa: ARG001 - the cache's key
    """Those of a defect that are computed so far."""
    return []


@lru_cache(maxsize=8192)
def _noise(seed: int, defect: int) -> tuple[np.random.Generator, list[float]]:
    """A defect's generator and what it has drawn so far; policies that are compared share them."""
    return child(seed, Stream.SENSING, defect), []


@lru_cache(maxsize=8192)
def _common(seed: int, defect: int) -> float:
    """Standard normal: how hard a defect is to find, for all looks."""
    return float(child(seed, Stream.SENSING, defect, _COMMON).standard_normal())
