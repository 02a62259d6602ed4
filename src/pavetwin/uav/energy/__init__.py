"""What flying costs in battery. One file a model, one registry."""

from pavetwin.uav.energy.base import CURVE_STEP_MPS, ENERGY_MODELS, EnergyCurve, energy_curve, energy_model

__all__ = ["CURVE_STEP_MPS", "ENERGY_MODELS", "EnergyCurve", "energy_curve", "energy_model"]
