"""The power of a multicopter over airspeed, from its profile."""

from functools import lru_cache
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.uav.aircraft import AIR_KG_M3, GRAVITY_MPS2, AircraftProfile, aircraft_of
from pavetwin.uav.energy.base import EnergyCurve, airspeeds, energy_model
from pavetwin.uav.energy.capacity import usable_wh

TIP_MPS: Final = 120.0
"""Tip speed of the rotor blades, table I of Zeng, Xu and Zhang 2019; no data sheet states it."""

BLADE_SHARE: Final = 79.86 / 88.63
"""Blade profile power over induced power in hover, P0 / Pi, of the same table."""

INDUCED_FACTOR: Final = 1.1
"""Induced power over that of an ideal rotor, 1 + k, of the same table."""


class Power(NamedTuple):
    """Electrical power in still air at each of `airspeeds()`, in watts, each (n,)."""

    lift_w: Float64Array
    """Induced power: falls with airspeed."""
    other_w: Float64Array
    """Blade profile and drag: rises with airspeed."""

    @property
    def total_w(self) -> Float64Array:
        return self.lift_w + self.other_w


class _Figures(NamedTuple):
    """What the curve of a profile depends on."""

    mass_kg: float
    disc_area_m2: float
    drag_area_m2: float
    top_speed_mps: float
    flight_w: float
    """On the maker's longest flight."""
    flight_speed_mps: float | None
    hover_w: float | None

    @classmethod
    def of(cls, profile: AircraftProfile) -> "_Figures":
        watt_min = profile.capacity_wh * 60
        return cls(
            profile.mass_kg,
            profile.disc_area_m2,
            profile.drag_area_m2,
            profile.top_speed_mps,
            watt_min / profile.flight_time_min,
            profile.flight_speed_mps,
            None if profile.hover_time_min is None else watt_min / profile.hover_time_min,
        )


def rotor_power(profile: AircraftProfile, payload_kg: float = 0.0) -> Power:
    """Power over airspeed of an aircraft in level flight.

    P(V) = P0 (1 + 3V²/U²) + Pi (√(1 + V⁴/4v0⁴) − V²/2v0²)^½ + ½ ρ f V³ (Y. Zeng, J. Xu, R. Zhang, "Energy Minimization
    for Wireless Communication With Rotary-Wing UAV", IEEE Trans. Wireless Commun. 18(4), 2019, eq. 12) with the
    aircraft's own v0 = √(W/2ρA), Pi = 1.1 W v0, and f from its tilt at top speed; P0/Pi and U are those of the source.

    The whole is scaled so that the power at the airspeed of the maker's longest flight empties the battery in its time;
    unless stated that is the airspeed of the lowest power up to the top speed. Where a hover time is stated too, Pi has
    a scale of its own, so that both times hold. The mass beyond that at which the
    maker measured scales P0 and Pi by its power 1.5 (fixed-pitch rotors: thrust ∝ n², power ∝ n³) and v0 by its root.

    Args:
        payload_kg: carried on top of the profile's own payload.
    """
    return _power(_Figures.of(profile), profile.flown_kg(payload_kg) / profile.mass_kg)


@lru_cache(maxsize=64)
def _power(figures: _Figures, heavier: float) -> Power:
    speed = airspeeds()
    lift_scale, other_scale = _scales(figures)
    blade_w, induced_w, drag_w = _terms(figures, speed, heavier)
    return Power(lift_scale * induced_w, other_scale * (blade_w + drag_w))


def _terms(
    figures: _Figures, speed: Float64Array, heavier: float = 1.0
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Aerodynamic power at airspeeds: blade profile, induced, drag, each (n,) watts; `heavier` times the mass."""
    weight_n = figures.mass_kg * GRAVITY_MPS2
    induced_mps = sqrt(weight_n / (2 * AIR_KG_M3 * figures.disc_area_m2))
    hover_w = INDUCED_FACTOR * weight_n * induced_mps * heavier**1.5
    ratio = speed**2 / (2 * induced_mps**2 * heavier)
    induced_w = hover_w * np.sqrt(np.sqrt(1 + ratio**2) - ratio)
    blade_w = BLADE_SHARE * hover_w * (1 + 3 * speed**2 / TIP_MPS**2)
    return blade_w, induced_w, AIR_KG_M3 * figures.drag_area_m2 * speed**3 / 2


@lru_cache(maxsize=64)
def _scales(figures: _Figures) -> tuple[float, float]:
    """Electrical over aerodynamic power: of the induced part, and of the rest."""
    speed = airspeeds()
    flown = speed[speed <= figures.top_speed_mps]
    if figures.flight_speed_mps is not None:
        flown = np.array([0.0, figures.flight_speed_mps])
    blade_w, induced_w, drag_w = _terms(figures, flown)

    if figures.hover_w is None:
        watts = blade_w + drag_w + induced_w
        scale = figures.flight_w / float(watts.min() if figures.flight_speed_mps is None else watts[1])
        return scale, scale
    # Where hovering takes `hover_w`, the power at any other airspeed is a straight line over the scale of the rest. The
    # lowest of the lines reaches `flight_w` where the last of those that begin below it does.
    per_induced, moving = figures.hover_w / float(induced_w[0]), slice(1, None)
    begin_w = per_induced * induced_w[moving]
    rise_w = (blade_w + drag_w)[moving] - float(blade_w[0] / induced_w[0]) * induced_w[moving]
    below = begin_w < figures.flight_w
    if not below.any():
        raise PaveTwinError(
            "aircraft: hovering for hover_time_min takes more power than a rotor can save in flight for "
            "flight_time_min; correct one of them, or omit hover_time_min."
        )
    other = float(((figures.flight_w - begin_w)[below] / rise_w[below]).max())
    return per_induced - other * float(blade_w[0] / induced_w[0]), other


@energy_model("rotor")
def rotor(settings: MissionSettings) -> EnergyCurve:
    """`rotor_power` of the aircraft over its usable energy, plus m·g·ḣ/η while climbing."""
    profile, energy = aircraft_of(settings), settings.energy
    if profile is None:
        raise PaveTwinError("energy.model: the model rotor needs an aircraft; give one, for example aircraft=mavic3e.")
    power, usable_j = rotor_power(profile, energy.payload_kg), usable_wh(settings, profile) * 3600
    climb_j_per_m = profile.flown_kg(energy.payload_kg) * GRAVITY_MPS2 / energy.climb_efficiency
    return EnergyCurve(power.total_w / usable_j, climb_j_per_m / usable_j, power.lift_w / usable_j)
