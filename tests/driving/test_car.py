"""The car's motion keeps the laws of the kinematic bicycle model and its limits, whatever the driver does."""

from itertools import pairwise
from math import atan2, cos, hypot, pi, radians, sin, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.driving.car import CarLimits, CarState, Pedals, moved, speed_after, steering_after

LIMITS = CarLimits()
STEP_S = 0.1
PEDALS = st.builds(Pedals, ahead=st.floats(-1, 1), left=st.floats(-1, 1), is_fast=st.booleans())


def rear(state: CarState) -> tuple[float, float]:
    return state.place(-LIMITS.wheelbase_m / 2)


def driven(pedals: list[Pedals], state: CarState) -> list[CarState]:
    states = [state]
    for each in pedals:
        speed = speed_after(states[-1].speed_mps, each, LIMITS, STEP_S)
        steering = steering_after(states[-1], each.left * LIMITS.steering_rad, LIMITS, STEP_S)
        states.append(moved(states[-1], speed, steering, LIMITS, STEP_S))
    return states


@given(st.lists(PEDALS, min_size=1, max_size=60))
def test_no_driver_leaves_the_limits(pedals: list[Pedals]) -> None:
    states = driven(pedals, CarState(3.0, -2.0, 0.4))
    for before, after in pairwise(states):
        change = (after.speed_mps - before.speed_mps) / STEP_S
        gains = abs(after.speed_mps) > abs(before.speed_mps)
        assert abs(change) <= (LIMITS.acceleration_mps2 if gains else LIMITS.braking_mps2) + 1e-9
        assert -LIMITS.reverse_mps - 1e-9 <= after.speed_mps <= LIMITS.fast_mps + 1e-9
        assert abs(after.steering_rad) <= LIMITS.steering_rad + 1e-9
        mean = 0.5 * (before.speed_mps + after.speed_mps)
        turned = (after.yaw_rad - before.yaw_rad) / STEP_S
        assert turned == pytest.approx(mean * tan(after.steering_rad) / LIMITS.wheelbase_m, abs=1e-9)
        assert hypot(*np.subtract(rear(after), rear(before))) <= abs(mean) * STEP_S + 1e-9
        # The rear axle does not slip: it moves along the mean of the body's directions.
        way, yaw = np.subtract(rear(after), rear(before)), 0.5 * (before.yaw_rad + after.yaw_rad)
        assert abs(way[0] * sin(yaw) - way[1] * cos(yaw)) < 1e-9


@given(st.floats(0.5, 13.8))
def test_steering_at_speed_keeps_to_the_lateral_acceleration(speed_mps: float) -> None:
    assert speed_mps**2 * tan(LIMITS.steering_at(speed_mps)) / LIMITS.wheelbase_m <= LIMITS.lateral_mps2 + 1e-9


def test_full_lock_drives_a_circle_and_comes_back() -> None:
    speed_mps = 2.0
    radius_m = LIMITS.wheelbase_m / tan(LIMITS.steering_rad)
    steps = 1000
    seconds = 2 * pi * radius_m / speed_mps / steps
    begun = state = CarState(0.0, 0.0, 0.0, speed_mps, LIMITS.steering_rad)
    places = [rear(state)]
    for _ in range(steps):
        state = moved(state, speed_mps, LIMITS.steering_rad, LIMITS, seconds)
        places.append(rear(state))
    assert (state.x_m, state.y_m) == pytest.approx((begun.x_m, begun.y_m), abs=1e-6)
    middle = np.mean(places[:-1], axis=0)
    assert np.hypot(*(np.array(places) - middle).T) == pytest.approx(radius_m, rel=1e-3)
    assert 3.0 < radius_m < 4.0


def test_brakes_first_and_reverses_after_that() -> None:
    states = driven([Pedals(ahead=1.0)] * 40 + [Pedals(ahead=-1.0)] * 60, CarState(0.0, 0.0, 0.0))
    speeds = [state.speed_mps for state in states]
    assert max(speeds) == pytest.approx(LIMITS.speed_mps)
    assert min(speeds) == pytest.approx(-LIMITS.reverse_mps)
    assert 0.0 in speeds[41:], "at rest between"
    assert states[-1].x_m < max(state.x_m for state in states)


@pytest.mark.parametrize(
    ("pedals", "rate"), [(Pedals(), LIMITS.slowing_mps2), (Pedals(ends=True), LIMITS.braking_mps2)]
)
def test_without_a_pedal_it_slows_down_and_stands(pedals: Pedals, rate: float) -> None:
    states = driven([pedals] * 100, CarState(0.0, 0.0, 0.0, speed_mps=10.0))
    assert states[1].speed_mps == pytest.approx(10.0 - rate * STEP_S)
    assert states[-1].speed_mps == 0.0
    assert states[-1] == driven([pedals], states[-1])[-1]
    assert states[-1].x_m == pytest.approx(10.0**2 / (2 * rate), rel=0.02)


def test_a_place_in_its_frame_turns_with_it() -> None:
    state = CarState(1.0, 2.0, radians(90))
    assert state.place(3.0, 1.0) == pytest.approx((0.0, 5.0))
    assert atan2(*reversed(np.subtract(state.place(1.0), state.place(0.0)))) == pytest.approx(radians(90))
