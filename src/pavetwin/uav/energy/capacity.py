"""How much of a battery's nominal energy a flight can use."""

from typing import Final

import numpy as np

from pavetwin.config.mission import MissionSettings
from pavetwin.uav.aircraft import AircraftProfile

CAPACITY_AT_C: Final = ((-20.0, 0.35), (-10.0, 0.55), (0.0, 0.75), (10.0, 0.90), (20.0, 1.0))
"""Share of the capacity that lithium polymer packs give at a temperature [°C], linear between. Operators and makers of
packs name losses of 20 to 30 % at 0 °C and 40 to 50 % at −10 °C; these are the middles. The other points are ours."""


def temperature_share(temperature_c: float) -> float:
    """Share of the capacity that a battery gives at its temperature, 0 … 1; constant beyond the known points."""
    temperatures, shares = zip(*CAPACITY_AT_C, strict=True)
    return float(np.interp(temperature_c, temperatures, shares))


def usable_wh(settings: MissionSettings, profile: AircraftProfile) -> float:
    """Energy of one set of batteries between a full charge and where the UAV must be on the ground: the nominal energy
    times the usable share, the health and what the temperature leaves."""
    energy = settings.energy
    nominal_wh = profile.capacity_wh if energy.capacity_wh is None else energy.capacity_wh
    return nominal_wh * energy.usable * energy.health * temperature_share(settings.conditions.temperature_c)
