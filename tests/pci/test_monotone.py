"""The curve through the points of the charts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from pavetwin.pci.monotone import MonotoneCurve

STEPS = st.lists(st.tuples(st.floats(0.01, 10.0), st.floats(-10.0, 10.0)), min_size=3, max_size=12)


@given(STEPS, st.lists(st.floats(0.0, 1.0), max_size=10))
def test_it_is_scipys(steps: list[tuple[float, float]], parts: list[float]) -> None:
    widths, heights = np.array(steps).T
    x = np.cumsum(widths)
    curve, known = MonotoneCurve.through(x, heights), PchipInterpolator(x, heights)
    for place in [*(x[0] + np.array(parts) * (x[-1] - x[0])), *x]:
        within = float(np.clip(place, x[0], x[-1]))
        assert curve.at(within) == pytest.approx(float(known(within)), rel=1e-9, abs=1e-9)


def test_it_goes_through_its_points_and_stays_between_them() -> None:
    curve = MonotoneCurve.through(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 0.0, 5.0, 5.0]))
    assert [curve.at(x) for x in (0.0, 1.0, 2.0, 3.0)] == [0.0, 0.0, 5.0, 5.0]
    assert curve.at(0.5) == 0.0
    assert curve.at(1.5) == pytest.approx(2.5)
    assert curve.at(2.5) == 5.0
