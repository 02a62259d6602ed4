"""A curve through points that does not overshoot between them.

A cubic Hermite spline whose slopes are weighted harmonic means (Fritsch and Butland 1984,
https://doi.org/10.1137/0905021), and at its ends those of the parabola through three points, limited as in `pchip` of
Moler's Numerical Computing with MATLAB (2004, section 3.4).

The same as `scipy.interpolate.PchipInterpolator`, whose import takes longer than a short mission flies.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pavetwin.arrays import Float64Array


@dataclass(frozen=True)
class MonotoneCurve:
    """Rises where its points rise, falls where they fall."""

    x: Float64Array
    """(n,), n ≥ 3, increasing."""
    y: Float64Array
    slopes: Float64Array

    @classmethod
    def through(cls, x: Float64Array, y: Float64Array) -> Self:
        widths, rises = np.diff(x), np.diff(y) / np.diff(x)
        one, other = 2 * widths[1:] + widths[:-1], widths[1:] + 2 * widths[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            means = (one + other) / (one / rises[:-1] + other / rises[1:])
        slopes = np.zeros(len(x))
        slopes[1:-1] = np.where(rises[:-1] * rises[1:] > 0, means, 0.0)
        slopes[0] = _end_slope(widths[0], widths[1], rises[0], rises[1])
        slopes[-1] = _end_slope(widths[-1], widths[-2], rises[-1], rises[-2])
        return cls(x, y, slopes)

    def at(self, x: float) -> float:
        """Its value.

        Args:
            x: between the first point and the last.
        """
        left = min(max(int(np.searchsorted(self.x, x, side="right")) - 1, 0), len(self.x) - 2)
        width = self.x[left + 1] - self.x[left]
        t = (x - self.x[left]) / width
        begin, end = (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t)
        leaving, arriving = t * (1 - t) ** 2 * width, t**2 * (t - 1) * width
        heights = begin * self.y[left] + end * self.y[left + 1]
        return float(heights + leaving * self.slopes[left] + arriving * self.slopes[left + 1])


def _end_slope(width: float, next_width: float, rise: float, next_rise: float) -> float:
    """Of the end beside an interval with this width and mean slope."""
    slope = ((2 * width + next_width) * rise - width * next_rise) / (width + next_width)
    if slope * rise <= 0:
        return 0.0
    return 3 * rise if rise * next_rise <= 0 and abs(slope) > abs(3 * rise) else slope
