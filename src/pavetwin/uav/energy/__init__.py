"""Battery use in flight. One file per model, one registry."""

from pavetwin.uav.energy.base import CURVE_STEP_MPS, ENERGY_MODELS, EnergyCurve, airspeeds, energy_curve, energy_model

__all__ = ["CURVE_STEP_MPS", "ENERGY_MODELS", "EnergyCurve", "airspeeds", "energy_curve", "energy_model"]
