"""What flying costs in battery: the paper's linear model and the rotary-wing power curve."""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import EnergySettings
from pavetwin.errors import PaveTwinError, nearest_name

CURVE_STEP_MPS = 0.1
CURVE_TOP_MPS = 60.0

GRAVITY_MPS2 = 9.81


@dataclass(frozen=True)
class EnergyCurve:
    """Battery drained, as the kernel reads it: linear between entries."""

    drain_per_s: Float64Array
    """Share of the battery a second at airspeeds 0, 0.1, 0.2 … m/s."""
    drain_per_m_climbed: float
    """Share of the battery a metre of climb, on top of the above. A descent gives nothing back."""


EnergyModel = Callable[[EnergySettings], EnergyCurve]

_MODELS: dict[str, EnergyModel] = {}


def energy_model(name: str) -> Callable[[EnergyModel], EnergyModel]:
    """Register an energy model under `name`, which `energy.model` then takes."""

    def register(model: EnergyModel) -> EnergyModel:
        if name in _MODELS:
            raise ValueError(f"an energy model '{name}' is registered already")
        _MODELS[name] = model
        return model

    return register


def energy_curve(settings: EnergySettings) -> EnergyCurve:
    """The curve of the model that the settings name."""
    if settings.model not in _MODELS:
        raise PaveTwinError(f"energy.model: no model '{settings.model}'{nearest_name(settings.model, _MODELS)}.")
    return _MODELS[settings.model](settings)


def _airspeeds() -> Float64Array:
    return np.arange(0, CURVE_TOP_MPS + CURVE_STEP_MPS, CURVE_STEP_MPS)


@energy_model("linear")
def linear(settings: EnergySettings) -> EnergyCurve:
    """e falls by 1/endurance a second whatever the UAV does (arXiv 2606.20742)."""
    return EnergyCurve(np.full_like(_airspeeds(), 1 / settings.endurance_s), 0.0)


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


@energy_model("rotor")
def rotor(settings: EnergySettings) -> EnergyCurve:
    """`rotor_power_w`, scaled so that hovering lasts `hover_endurance_s`, plus m·g·ḣ/η while climbing."""
    capacity_j = settings.capacity_wh * 3600
    scale = capacity_j / settings.hover_endurance_s / rotor_power_w(0)
    power_w = np.array([rotor_power_w(float(speed)) for speed in _airspeeds()]) * scale
    climb_j_per_m = settings.mass_kg * GRAVITY_MPS2 / settings.climb_efficiency
    return EnergyCurve(power_w / capacity_j, climb_j_per_m / capacity_j)
