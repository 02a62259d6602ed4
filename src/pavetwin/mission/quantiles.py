"""Quantiles of the beta distribution and of Student's t.

SciPy has both (`scipy.special.betaincinv`, `stdtrit`), and takes longer to import than all else that a mission's table
needs. These agree with it to ten digits.
"""

from math import exp, lgamma, log, log1p, sqrt
from typing import Final

_TINY: Final = 1e-300
"""In the place of zero in a denominator of Lentz's method, and below it a quantile is 0."""
_LAST: Final = 1e-16
"""A step of this relative size changes nothing any more."""


def beta_quantile(a: float, b: float, share: float) -> float:
    """The x below which a beta distribution with parameters a, b > 0 has the `share` of its mass, 0 < share < 1.

    Newton's method on the regularised incomplete beta function, kept within the interval that its values leave. It
    begins where xᵃ / a B(a, b), which the function is for small x, has the share, or at the mean.
    """
    low, high = 0.0, 1.0
    power = (log(share) + log(a) + _log_beta(a, b)) / a
    if power < log(_TINY):
        return 0.0
    x = min(a / (a + b), exp(min(power, 0.0)))
    for _ in range(200):
        excess = beta_share(a, b, x) - share
        if excess > 0:
            high = x
        else:
            low = x
        slope = exp((a - 1) * log(x) + (b - 1) * log1p(-x) - _log_beta(a, b))
        step = excess / slope if slope > 0 else 0.0
        following = x - step
        if not low < following < high or step == 0.0:
            following = (low + high) / 2
        if abs(following - x) <= _LAST * x or following in (low, high):
            return following
        x = following
    return x


def beta_share(a: float, b: float, x: float) -> float:
    """The share of a beta distribution's mass below x, 0 < x < 1: the regularised incomplete beta function I_x(a, b).

    By its continued fraction (Digital Library of Mathematical Functions, 8.17.22) and Lentz's method, on the side of
    the mean where it converges fast.
    """
    if x > (a + 1) / (a + b + 2):
        return 1.0 - beta_share(b, a, 1.0 - x)
    whole, above, below = 1.0, 1.0, 0.0
    for term in range(1, 10_000):
        m = term // 2
        if term % 2:
            factor = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        else:
            factor = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        below = 1.0 / (1.0 + factor * below or _TINY)
        above = 1.0 + factor / above or _TINY
        whole *= above * below
        if abs(above * below - 1.0) < _LAST:
            break
    return exp(a * log(x) + b * log1p(-x) - _log_beta(a, b)) / (a * whole)


def t_quantile(freedom: float, share: float) -> float:
    """The value below which Student's t with `freedom` > 0 degrees of freedom is with a chance of `share`, above ½."""
    outside = beta_quantile(freedom / 2, 0.5, 2 * (1 - share))
    return sqrt(freedom * (1 - outside) / outside)


def _log_beta(a: float, b: float) -> float:
    return lgamma(a) + lgamma(b) - lgamma(a + b)
