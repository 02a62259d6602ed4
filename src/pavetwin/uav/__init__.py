"""Airframe, cameras, battery."""

from pavetwin.uav.cameras import CAMERAS, Camera, find_camera
from pavetwin.uav.energy import EnergyCurve, energy_curve, energy_model

__all__ = ["CAMERAS", "Camera", "EnergyCurve", "energy_curve", "energy_model", "find_camera"]
