"""Curves through points, against SciPy's."""

from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from pavetwin.pci.monotone import MonotoneCurve

HEIGHTS = st.lists(st.integers(-3, 3).map(float), min_size=3, max_size=8)


@given(heights=HEIGHTS, widths=st.lists(st.floats(0.1, 3.0), min_size=8, max_size=8), share=st.floats(0, 1))
def test_the_curve_is_scipys(heights: list[float], widths: list[float], share: float) -> None:
    x = [sum(widths[:k]) for k in range(len(heights))]
    curve, theirs = MonotoneCurve.through(x, heights), PchipInterpolator(x, heights)
    for at in (*x, x[0] + share * (x[-1] - x[0])):
        assert abs(curve(at) - float(theirs(at))) < 1e-12
