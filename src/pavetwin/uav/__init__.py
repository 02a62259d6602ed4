"""Aircraft: profiles, cameras, energy and wind."""

from pavetwin.uav.aircraft import AIRCRAFT, AircraftProfile, aircraft_of, camera_of, find_aircraft
from pavetwin.uav.cameras import CAMERAS, Camera, find_camera
from pavetwin.uav.energy import EnergyCurve, energy_curve, energy_model

__all__ = [
    "AIRCRAFT",
    "CAMERAS",
    "AircraftProfile",
    "Camera",
    "EnergyCurve",
    "aircraft_of",
    "camera_of",
    "energy_curve",
    "energy_model",
    "find_aircraft",
    "find_camera",
]
