"""What an energy model is, and where models are registered."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import EnergySettings
from pavetwin.registry import Registry

CURVE_STEP_MPS = 0.1
CURVE_TOP_MPS = 60.0


@dataclass(frozen=True)
class EnergyCurve:
    """Battery drained, as the kernel reads it: linear between entries."""

    drain_per_s: Float64Array
    """Share of the battery per second at airspeeds 0, 0.1, 0.2 … m/s."""
    drain_per_m_climbed: float
    """Share of the battery per metre of climb, added to the above. A descent recovers nothing."""


EnergyModel = Callable[[EnergySettings], EnergyCurve]

ENERGY_MODELS: Registry[EnergyModel] = Registry(
    "energy model", key="energy.model", group="pavetwin.energy_models", home="pavetwin.uav.energy"
)
energy_model = ENERGY_MODELS.register
"""Register an energy model under a name, which `energy.model` then takes."""


def energy_curve(settings: EnergySettings) -> EnergyCurve:
    """The curve of the model that the settings name.

    Raises:
        PaveTwinError: there is no such model.
    """
    return ENERGY_MODELS.get(settings.model)(settings)


def airspeeds() -> Float64Array:
    """The airspeeds of a curve's entries [m/s]."""
    return np.arange(0, CURVE_TOP_MPS + CURVE_STEP_MPS, CURVE_STEP_MPS)
