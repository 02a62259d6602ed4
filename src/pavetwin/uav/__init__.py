"""Airframe, cameras, battery."""

from pavetwin.uav.cameras import Camera, cameras, find_camera
from pavetwin.uav.energy import EnergyCurve, energy_curve, energy_model

__all__ = ["Camera", "EnergyCurve", "cameras", "energy_curve", "energy_model", "find_camera"]
