"""The power curve of a rotary wing."""

from functools import cache
from math import sqrt

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import EnergySettings
from pavetwin.uav.energy.base import EnergyCurve, airspeeds, energy_model

GRAVITY_MPS2 = 9.81


def rotor_power_w(airspeed_mps: float) -> float:
    """Power of a rotary-wing UAV in forward flight, in watts.

    P(V) = P0 (1 + 3V²/U²) + Pi (√(1 + V⁴/4v0⁴) − V²/2v0²)^½ + ½ d0 ρ s A V³, with the values of its source:
    Y. Zeng, J. Xu, R. Zhang, "Energy Minimization for Wireless Communication With Rotary-Wing UAV", IEEE Trans.
    Wireless Commun. 18(4), 2019, eq. 12 and table I.
    """
    blade_w, induced_w, tip_mps, induced_mps = 79.86, 88.63, 120.0, 4.03
    drag_ratio, solidity, disc_m2, air_kg_m3 = 0.6, 0.05, 0.503, 1.225
    ratio = airspeed_mps**2 / (2 * induced_mps**2)
    profile = blade_w * (1 + 3 * airspeed_mps**2 / tip_mps**2)
    induced = induced_w * sqrt(sqrt(1 + ratio**2) - ratio)
    parasite = 0.5 * drag_ratio * air_kg_m3 * solidity * disc_m2 * airspeed_mps**3
    return profile + induced + parasite


@cache
def _curve_w() -> Float64Array:
    """(n,) power at each of `airspeeds()`."""
    return np.array([rotor_power_w(float(speed)) for speed in airspeeds()])


@energy_model("rotor")
def rotor(settings: EnergySettings) -> EnergyCurve:
    """`rotor_power_w`, scaled so that hovering lasts `hover_endurance_s`, plus m·g·ḣ/η while climbing."""
    capacity_j = settings.capacity_wh * 3600
    scale = capacity_j / settings.hover_endurance_s / rotor_power_w(0)
    power_w = _curve_w() * scale
    climb_j_per_m = settings.mass_kg * GRAVITY_MPS2 / settings.climb_efficiency
    return EnergyCurve(power_w / capacity_j, climb_j_per_m / capacity_j)
