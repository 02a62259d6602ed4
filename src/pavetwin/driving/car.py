"""Motion of the car: the kinematic bicycle model about the rear axle.

With the speed v, the steering angle δ of the front wheels and the wheelbase L, the middle of the rear axle moves along
the body and the yaw changes by v tan δ / L (Rajamani, Vehicle Dynamics and Control, 2nd ed. 2012, section 2.2). Tyres
do not slip, which holds for the lateral accelerations that `CarLimits` allows.
"""

from dataclasses import dataclass, replace
from math import atan, copysign, cos, inf, radians, sin, tan
from typing import Final

from pavetwin.traffic.kinds import KINDS

BODY: Final = KINDS["hatchback"]
"""The vehicle kind with the car's length, width and height."""


@dataclass(frozen=True, slots=True)
class Pedals:
    """A driver's input: shares, −1 … 1."""

    ahead: float = 0.0
    """Share of the speed; below 0 to brake and then to reverse; at 0 the car slows down."""
    left: float = 0.0
    """Share of the largest steering angle."""
    is_fast: bool = False
    """Drive at the higher of the two speeds."""
    ends: bool = False
    """Come to rest and end the drive; cannot be taken back."""


@dataclass(frozen=True, slots=True)
class CarLimits:
    """Limits of the car."""

    speed_mps: float = 30 / 3.6
    """Estimate for a calm drive in a town."""
    fast_mps: float = 50 / 3.6
    """The usual limit in towns."""
    reverse_mps: float = 2.0
    """Estimate."""
    acceleration_mps2: float = 2.6
    """SUMO's passenger cars: SUMO, Vehicle Type Parameter Defaults."""
    braking_mps2: float = 4.5
    """SUMO's passenger cars."""
    slowing_mps2: float = 2.0
    """Deceleration without a pedal. By judgement, like electric cars."""
    lateral_mps2: float = 4.0
    """Estimate: about half the limit of dry asphalt. It limits the steering angle at speed."""
    steering_rad: float = radians(35.0)
    """Largest angle of the front wheels. By judgement: a turning circle of some 10 m, like small cars."""
    steering_rad_s: float = radians(45.0)
    """Turn rate of the front wheels. By judgement: from straight ahead to full lock in 0.8 s."""
    wheelbase_m: float = 2.43
    """Estimate for a body of 3.8 m. The axles are as far ahead of the middle as behind it."""
    track_m: float = 1.48
    """Distance between the wheels of an axle. By judgement."""

    def steering_at(self, speed_mps: float) -> float:
        """The largest steering angle at a speed [rad]: a_lat = v² tan δ / L."""
        squared = speed_mps * speed_mps
        return min(self.steering_rad, atan(self.wheelbase_m * self.lateral_mps2 / squared) if squared else inf)


@dataclass(frozen=True, slots=True)
class CarState:
    """State of the car, world frame."""

    x_m: float
    """Centre of the body."""
    y_m: float
    yaw_rad: float
    speed_mps: float = 0.0
    """Speed of the rear axle; below 0 in reverse."""
    steering_rad: float = 0.0
    """Angle of the front wheels, counter-clockwise."""

    @property
    def velocity_mps(self) -> tuple[float, float]:
        """Velocity along the body (east, north)."""
        return self.speed_mps * cos(self.yaw_rad), self.speed_mps * sin(self.yaw_rad)

    def place(self, ahead_m: float, left_m: float = 0.0) -> tuple[float, float]:
        """World coordinates of a place in the body's frame."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        return self.x_m + ahead_m * c - left_m * s, self.y_m + ahead_m * s + left_m * c


def speed_after(speed_mps: float, pedals: Pedals, limits: CarLimits, seconds: float) -> float:
    """The speed after a time. A braking car comes to rest before it reverses."""
    fastest = limits.fast_mps if pedals.is_fast else limits.speed_mps
    wanted = pedals.ahead * (fastest if pedals.ahead > 0 else limits.reverse_mps)
    if pedals.ends or pedals.ahead == 0:
        rate = limits.braking_mps2 if pedals.ends else limits.slowing_mps2
        return copysign(max(0.0, abs(speed_mps) - rate * seconds), speed_mps)
    if speed_mps * wanted < 0:
        return copysign(max(0.0, abs(speed_mps) - limits.braking_mps2 * seconds), speed_mps)
    if abs(wanted) >= abs(speed_mps):
        return copysign(min(abs(wanted), abs(speed_mps) + limits.acceleration_mps2 * seconds), wanted)
    return copysign(max(abs(wanted), abs(speed_mps) - limits.slowing_mps2 * seconds), wanted)


def steering_after(state: CarState, wanted_rad: float, limits: CarLimits, seconds: float) -> float:
    """The steering angle after a time, within the limit at the speed."""
    most, turn = limits.steering_at(state.speed_mps), limits.steering_rad_s * seconds
    turned = min(max(wanted_rad, state.steering_rad - turn), state.steering_rad + turn)
    return min(max(turned, -most), most)


def moved(state: CarState, speed_mps: float, steering_rad: float, limits: CarLimits, seconds: float) -> CarState:
    """The state after a time, at the mean of the speeds along an arc."""
    half_m = limits.wheelbase_m / 2
    x, y = state.place(-half_m)
    way_m = 0.5 * (state.speed_mps + speed_mps) * seconds
    turned = way_m * tan(steering_rad) / limits.wheelbase_m
    chord_m = way_m * (sin(turned / 2) / (turned / 2) if abs(turned) > 1e-9 else 1.0)
    middle, yaw = state.yaw_rad + turned / 2, state.yaw_rad + turned
    x, y = x + chord_m * cos(middle), y + chord_m * sin(middle)
    rear = replace(state, x_m=x, y_m=y, yaw_rad=yaw, speed_mps=speed_mps, steering_rad=steering_rad)
    ahead = rear.place(half_m)
    return replace(rear, x_m=ahead[0], y_m=ahead[1])
