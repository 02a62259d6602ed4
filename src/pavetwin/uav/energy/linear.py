"""The paper's energy model."""

import numpy as np

from pavetwin.config.mission import MissionSettings
from pavetwin.uav.energy.base import EnergyCurve, airspeeds, energy_model


@energy_model("linear")
def linear(settings: MissionSettings) -> EnergyCurve:
    """The battery falls by 1/endurance per second whatever the UAV does (arXiv 2606.20742)."""
    return EnergyCurve(np.full_like(airspeeds(), 1 / settings.energy.endurance_s), 0.0)
