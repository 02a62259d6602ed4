"""What an energy model is, and where models are registered."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import MissionSettings
from pavetwin.registry import Registry

CURVE_STEP_MPS = 0.1
CURVE_TOP_MPS = 60.0


def airspeeds() -> Float64Array:
    """(n,) the airspeeds of a curve's entries [m/s]."""
    return np.arange(0, CURVE_TOP_MPS + CURVE_STEP_MPS, CURVE_STEP_MPS)


def _no_lift() -> Float64Array:
    return np.zeros_like(airspeeds())


@dataclass(frozen=True)
class EnergyCurve:
    """Battery drained, as the kernel reads it: linear between entries."""

    drain_per_s: Float64Array
    """(n,) share of the battery per second in still air, at airspeeds 0, 0.1, 0.2 … m/s."""
    drain_per_m_climbed: float
    """Share of the battery per metre of climb, added to the above. A descent recovers nothing."""
    lift_per_s: Float64Array = field(default_factory=_no_lift)
    """(n,) the part of `drain_per_s` that moving through the air saves: it falls with airspeed. In wind it is read at
    the ground speed where that is lower, so that wind alone saves nothing."""


EnergyModel = Callable[[MissionSettings], EnergyCurve]

ENERGY_MODELS: Registry[EnergyModel] = Registry(
    "energy model", key="energy.model", group="pavetwin.energy_models", home="pavetwin.uav.energy"
)
energy_model = ENERGY_MODELS.register
"""Register an energy model under a name, which `energy.model` then takes."""


def energy_curve(settings: MissionSettings) -> EnergyCurve:
    """The curve of the model that the settings name.

    Raises:
        PaveTwinError: there is no such model, or it lacks what it is computed from.
    """
    return ENERGY_MODELS.get(settings.energy.model)(settings)
