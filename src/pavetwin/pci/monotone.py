"""Curves through points that rise and fall only where the points do."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import copysign
from typing import Self


class MonotoneCurve:
    """A cubic Hermite curve whose slopes keep it monotone between points (F. N. Fritsch, J. Butland, "A method for
    constructing local monotone piecewise cubic interpolants", SIAM J. Sci. Stat. Comput. 5(2), 1984).

    The same numbers as `scipy.interpolate.PchipInterpolator`, for one place at a time, without the time that SciPy
    takes to import.
    """

    def __init__(self, x: Sequence[float], y: Sequence[float], slopes: Sequence[float]) -> None:
        """Args:
        x: increasing, two or more.
        slopes: of the curve at each point.
        """
        self._x, self._y, self._slopes = x, y, slopes

    @classmethod
    def through(cls, x: Sequence[float], y: Sequence[float]) -> Self:
        """The curve through points, three or more, x increasing."""
        widths = [after - before for before, after in pairwise(x)]
        rises = [(after - before) / width for (before, after), width in zip(pairwise(y), widths, strict=True)]
        within = [_slope(*each) for each in zip(widths, widths[1:], rises, rises[1:], strict=False)]
        first, last = _end(*widths[:2], *rises[:2]), _end(*widths[:-3:-1], *rises[:-3:-1])
        return cls(x, y, (first, *within, last))

    def __call__(self, x: float) -> float:
        """The curve's height at a place from the first point to the last."""
        at = min(max(bisect_right(self._x, x), 1), len(self._x) - 1) - 1
        width, along = self._x[at + 1] - self._x[at], x - self._x[at]
        begin, end = self._slopes[at : at + 2]
        rise = (self._y[at + 1] - self._y[at]) / width
        bend = (begin + end - 2 * rise) / width
        square = along * along
        return self._y[at] + begin * along + ((rise - begin) / width - bend) * square + bend / width * (square * along)


def _slope(before: float, after: float, falls: float, rises: float) -> float:
    """At a point between two intervals, by their widths and mean slopes: their weighted harmonic mean."""
    if falls * rises <= 0:
        return 0.0
    first, second = 2 * after + before, after + 2 * before
    return 1 / ((first / falls + second / rises) / (first + second))


def _end(width: float, following: float, rise: float, beyond: float) -> float:
    """At the first or the last point: of the parabola through three, where that keeps the shape."""
    slope = ((2 * width + following) * rise - width * beyond) / (width + following)
    if slope == 0 or rise == 0 or copysign(1, slope) != copysign(1, rise):
        return 0.0
    return 3 * rise if rise * beyond <= 0 and abs(slope) > 3 * abs(rise) else slope
