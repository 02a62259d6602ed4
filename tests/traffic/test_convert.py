"""From SUMO's front bumper and compass heading to a body's centre and yaw: the laws of the change of frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.traffic.job import centre_of_front, yaw_of_heading

degrees = st.floats(0.0, 360.0)
metres = st.floats(-1e4, 1e4)


@pytest.mark.parametrize(
    ("heading_deg", "yaw_rad"), [(90.0, 0.0), (0.0, math.pi / 2), (180.0, -math.pi / 2), (45.0, math.pi / 4)]
)
def test_the_compass_points(heading_deg: float, yaw_rad: float) -> None:
    assert yaw_of_heading(heading_deg) == pytest.approx(yaw_rad)


@given(degrees)
def test_yaw_points_where_the_heading_points(heading_deg: float) -> None:
    yaw = float(yaw_of_heading(heading_deg))
    assert -math.pi <= yaw <= math.pi
    east, north = math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))
    assert (math.cos(yaw), math.sin(yaw)) == pytest.approx((east, north), abs=1e-9)


@given(degrees, metres, metres, st.floats(0.2, 20.0))
def test_the_front_is_half_a_length_ahead_of_the_centre(heading_deg: float, x: float, y: float, length: float) -> None:
    yaw = yaw_of_heading(heading_deg)
    centre = centre_of_front((x, y), yaw, length)
    ahead = np.array([math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))])
    assert centre + ahead * length / 2 == pytest.approx(np.array([x, y]), abs=1e-6)


def test_many_bodies_at_once() -> None:
    centre = centre_of_front([(10.0, 0.0), (0.0, 10.0)], yaw_of_heading([90.0, 0.0]), [4.0, 12.0])
    assert centre == pytest.approx(np.array([[8.0, 0.0], [0.0, 4.0]]))
