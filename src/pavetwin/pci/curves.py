"""The curves of ASTM D6433 for asphalt: deduct values over density (its appendix X3), and their correction.

The standard prints them as charts. The points are those that the Ruby library `pavement_condition_index` (Brand New
Box, MIT) read from the charts; shoving to weathering included, `docs/explanation/pci.md` compares them with worked
examples. Between points the curves are interpolated without overshoot (Fritsch and Carlson 1980), over the logarithm
of the density. The charts are in feet; densities here are in metres and converted.
"""

from collections.abc import Callable
from functools import cache
from math import log10
from typing import Final

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.defects.severity import Distress
from pavetwin.world.model import Severity

FOOT_M: Final = 0.3048

_WHOLE: Final = (0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0, 20.0, 40.0, 100.0)
_TO_50: Final = (*_WHOLE[:-1], 50.0)
_TO_30: Final = (*_WHOLE[:8], 30.0)
_TO_20: Final = _WHOLE[:8]
_OF_POTHOLES: Final = (0.01, 0.02, 0.04, 0.1, 0.2, 0.4, 1.0, 2.0, 4.0, 10.0)

DEDUCT_POINTS: Final[dict[Distress, tuple[tuple[float, ...], str, str, str]]] = {
    Distress.ALLIGATOR_CRACKING: (
        _WHOLE,
        "3.7 4.0 4.9 10.7 16.9 23.7 32.8 40.0 48.7 61.7",
        "6.3 9.9 13.8 21.3 27.9 35.3 45.8 54.8 64.3 77.4",
        "11.9 15.6 20.1 30.0 39.9 49.8 61.1 70.0 78.9 91.1",
    ),
    Distress.BLOCK_CRACKING: (
        _WHOLE,
        "0.0 0.0 0.1 0.2 1.3 3.7 7.4 12.2 17.6 27.2",
        "0.0 0.0 0.1 2.2 5.4 9.1 15.0 21.9 30.2 42.6",
        "0.0 1.3 2.7 6.3 11.7 17.4 28.0 40.2 53.7 71.5",
    ),
    Distress.EDGE_CRACKING: (
        _TO_20,
        "0.0 1.4 2.1 3.7 4.9 6.6 11.5 15.4",
        "4.3 4.9 5.9 9.1 12.5 17.0 24.3 28.5",
        "7.2 9.3 11.0 14.6 20.5 27.4 40.6 46.7",
    ),
    Distress.JOINT_REFLECTION_CRACKING: (
        _TO_30,
        "0.0 1.0 1.6 3.0 4.9 8.7 15.6 22.6 27.6",
        "1.3 2.3 4.2 8.3 12.7 20.5 35.0 41.7 43.7",
        "2.4 5.8 10.3 16.3 23.4 38.3 62.6 71.7 73.9",
    ),
    Distress.LONGITUDINAL_AND_TRANSVERSE_CRACKING: (
        _TO_30,
        "0.0 0.0 0.3 2.0 5.2 9.3 16.7 23.9 28.5",
        "0.0 0.7 3.3 8.7 14.1 20.0 30.4 39.8 44.4",
        "3.9 6.7 10.9 18.3 27.0 38.9 60.9 79.1 86.9",
    ),
    Distress.PATCHING: (
        _TO_50,
        "0.0 0.3 0.5 2.0 4.3 7.9 16.1 23.3 31.3 33.0",
        "2.6 3.8 5.7 9.4 13.6 19.6 31.3 42.0 54.1 57.6",
        "6.3 8.6 12.9 19.4 25.3 33.7 51.9 67.0 77.6 80.2",
    ),
    Distress.POTHOLES: (
        _OF_POTHOLES,
        "1.8 5.6 10.9 21.7 31.6 42.5 58.3 71.4 84.0 100.0",
        "6.0 10.7 18.9 34.6 49.7 66.0 91.7 111.9 132.5 159.1",
        "20.1 27.6 37.6 55.4 71.4 87.7 109.6 125.6 141.8 162.6",
    ),
    Distress.RAVELING: (
        _WHOLE,
        "0.0 0.8 1.6 2.4 2.7 3.3 5.2 7.8 11.3 16.3",
        "4.1 5.6 7.0 8.7 10.6 12.7 18.0 25.0 32.0 44.1",
        "6.3 8.8 11.6 16.3 20.3 27.2 40.6 54.8 65.4 78.0",
    ),
    Distress.RUTTING: (
        _WHOLE,
        "0.6 0.8 2.7 7.2 12.5 18.5 26.5 34.8 44.1 49.6",
        "3.5 6.4 9.9 17.2 24.2 31.8 43.7 54.1 61.1 67.6",
        "5.4 11.6 17.9 26.9 35.1 45.0 61.1 73.7 83.1 90.0",
    ),
    Distress.SHOVING: (
        _TO_50,
        "0.4 0.4 0.5 4.1 8.1 12.4 20.2 27.8 34.8 36.5",
        "3.1 3.3 4.2 10.0 15.0 21.7 34.8 49.3 61.7 64.8",
        "7.6 9.8 11.6 18.9 25.6 33.9 52.2 66.5 77.0 80.0",
    ),
}
"""Densities [%] of the charts, and the deduct values there of low, medium and high severity."""

CORRECTED_TOTALS: Final = tuple(float(total) for total in range(30, 201, 10))
CORRECTED_POINTS: Final = {
    2: "21.9 29.3 36.9 43.7 50.4 57.4 63.7 69.8 75.4 80.7 85.6 90.0 93.9 97.6 101.3 104.3 106.7 108.9",
    3: "16.7 24.3 31.1 37.8 44.8 50.7 56.9 63.0 68.3 73.1 78.3 83.3 88.0 92.0 96.3 99.8 103.0 105.0",
    4: "12.4 19.3 26.3 33.0 39.4 45.6 51.1 56.7 62.4 67.8 73.1 78.5 82.8 86.9 90.4 93.3 95.9 98.1",
    5: "9.3 16.3 22.8 28.9 35.2 40.9 46.7 51.9 57.0 62.4 67.2 72.2 76.7 80.9 84.8 88.1 91.1 93.3",
    6: "6.1 13.1 19.8 25.6 31.7 37.6 43.0 48.1 53.3 58.7 63.1 68.0 72.8 77.2 81.3 84.6 87.6 90.2",
    7: "6.1 13.1 19.8 25.6 31.7 37.6 43.0 48.1 53.3 58.7 63.1 67.4 71.3 74.8 77.2 79.4 81.1 82.2",
}
"""Corrected deduct values at `CORRECTED_TOTALS`, by the number q of deduct values above 2; 7 stands for more too."""


def deduct_value(distress: Distress, severity: Severity, density: float) -> float:
    """The deduct value of a distress, 0 to 100.

    Args:
        density: quantity over the area of the sample unit, as a percentage: m² per m², m per m², or number per m².

    Below the first density of a chart the value falls linearly to 0; beyond the last it is constant. A severity deducts
    no less than a lower one: between points that two charts share, their curves may cross by a hundredth.

    Raises:
        ValueError: the density is negative or not a number.
    """
    if not density >= 0:
        raise ValueError(f"a density of {density} % is below 0")
    charted = density * _CHARTED.get(distress.unit, 1.0)
    densities = DEDUCT_POINTS[distress][0]
    first, last = densities[0], densities[-1]
    within = min(max(charted, first), last)
    up_to_it = tuple(Severity)[: tuple(Severity).index(severity) + 1]
    value = max(float(_deduct_curve(distress, each)(log10(within))) for each in up_to_it)
    return min(100.0, value * min(1.0, charted / first))


_CHARTED: Final = {"m": FOOT_M, "number": FOOT_M**2}
"""Factor from a density in metres to the charts' feet, by the unit of the quantity."""


def corrected_deduct_value(total: float, q: int) -> float:
    """The corrected deduct value of a total of deduct values, q ≥ 1 of which are above 2; 0 to 100.

    Below the charts' 30 the curve is extended linearly.
    """
    if q <= 1:
        return min(100.0, total)
    points = _values(CORRECTED_POINTS[min(q, max(CORRECTED_POINTS))])
    totals = CORRECTED_TOTALS
    if total < totals[0]:
        slope = (points[1] - points[0]) / (totals[1] - totals[0])
        return max(0.0, float(points[0] + slope * (total - totals[0])))
    return min(100.0, float(np.interp(total, totals, points)))


@cache
def _deduct_curve(distress: Distress, severity: Severity) -> Callable[[float], Float64Array]:
    from scipy.interpolate import PchipInterpolator  # a quarter of a second that most commands need not wait

    densities, *curves = DEDUCT_POINTS[distress]
    curve: Callable[[float], Float64Array] = PchipInterpolator(
        np.log10(densities), _values(curves[tuple(Severity).index(severity)])
    )
    return curve


def _values(points: str) -> Float64Array:
    return np.array([float(word) for word in points.split()])
