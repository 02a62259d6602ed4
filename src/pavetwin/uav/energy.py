"""Energy models: the battery drained in flight, over airspeed and climb, and their registry."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from math import sqrt
from typing import Final, NamedTuple

import numpy as np

from pavetwin.arrays import Float64Array
from pavetwin.config.mission import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.registry import Registry
from pavetwin.uav.aircraft import AIR_KG_M3, GRAVITY_MPS2, AircraftProfile, aircraft_of

CURVE_STEP_MPS = 0.1
CURVE_TOP_MPS = 60.0


def airspeeds() -> Float64Array:
    """(n,) the airspeeds of a curve's entries [m/s]."""
    return np.arange(0, CURVE_TOP_MPS + CURVE_STEP_MPS, CURVE_STEP_MPS)


def _no_lift() -> Float64Array:
    return np.zeros_like(airspeeds())


@dataclass(frozen=True)
class EnergyCurve:
    """Battery drain for the kernel, linear between entries."""

    drain_per_s: Float64Array
    """(n,) share of the battery per second in still air, at airspeeds 0, 0.1, 0.2 … m/s."""
    drain_per_m_climbed: float
    """Share of the battery per metre of climb, added to the above. A descent recovers nothing."""
    lift_per_s: Float64Array = field(default_factory=_no_lift)
    """(n,) the part of `drain_per_s` that falls with airspeed. In wind it is read at the ground speed if that is lower,
    so that wind alone saves nothing."""


EnergyModel = Callable[[MissionSettings], EnergyCurve]

ENERGY_MODELS: Registry[EnergyModel] = Registry(
    "energy model", key="energy.model", group="pavetwin.energy_models", home="pavetwin.uav.energy"
)
energy_model = ENERGY_MODELS.register
"""Register an energy model under a name, which `energy.model` then takes."""


def energy_curve(settings: MissionSettings) -> EnergyCurve:
    """The energy curve of the settings' model.

    Raises:
        PaveTwinError: there is no such model, or an input of it is missing.
    """
    return ENERGY_MODELS.get(settings.energy.model)(settings)


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


@energy_model("linear")
def linear(settings: MissionSettings) -> EnergyCurve:
    """The battery falls by 1/endurance per second whatever the UAV does (arXiv 2606.20742)."""
    return EnergyCurve(np.full_like(airspeeds(), 1 / settings.energy.endurance_s), 0.0)


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
    """The figures of a profile that its curve depends on."""

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
