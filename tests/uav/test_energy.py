"""The energy models against their formulas, their source's numbers and their laws."""

from math import sqrt

import numpy as np
import pytest

from pavetwin.config.mission import EnergySettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.track import MODES
from pavetwin.twin import Mode
from pavetwin.uav import energy_curve, energy_model
from pavetwin.uav.energy import CURVE_STEP_MPS
from pavetwin.uav.energy.rotor import rotor_power_w
from scenes.tiny import Scene, result, straight

AIRSPEEDS = np.arange(601) * CURVE_STEP_MPS


def test_the_linear_model_empties_the_battery_in_30_minutes_whatever_the_uav_does() -> None:
    curve = energy_curve(EnergySettings(model="linear"))
    assert (curve.drain_per_s == 1 / 1800).all()
    assert curve.drain_per_m_climbed == 0.0
    assert (energy_curve(EnergySettings(model="linear", endurance_s=600)).drain_per_s == 1 / 600).all()


@pytest.mark.parametrize(("airspeed_mps", "power_w"), [(0.0, 168.49), (10.0, 126.0), (20.0, 180.0), (30.0, 362.0)])
def test_the_rotor_curve_is_that_of_its_source(airspeed_mps: float, power_w: float) -> None:
    """Zeng, Xu, Zhang 2019, fig. 2: 168 W hovering, about 126 W at its lowest, and 180 W and 360 W at speed."""
    assert rotor_power_w(airspeed_mps) == pytest.approx(power_w, rel=0.04)


@pytest.mark.parametrize("airspeed_mps", [0.0, 3.3, 10.2, 27.0])
def test_the_rotor_curve_is_its_formula(airspeed_mps: float) -> None:
    v = airspeed_mps
    blade = 79.86 * (1 + 3 * v**2 / 120**2)
    induced = 88.63 * (sqrt(1 + v**4 / (4 * 4.03**4)) - v**2 / (2 * 4.03**2)) ** 0.5
    parasite = 0.5 * 0.6 * 1.225 * 0.05 * 0.503 * v**3
    assert rotor_power_w(v) == pytest.approx(blade + induced + parasite, rel=1e-9)


def test_hovering_empties_the_battery_in_28_minutes_at_174_watts() -> None:
    curve = energy_curve(EnergySettings())
    assert curve.drain_per_s[0] == pytest.approx(1 / (28 * 60))
    assert curve.drain_per_s[0] * 81.3 * 3600 == pytest.approx(174.2, abs=0.1)


def test_flying_at_about_10_metres_a_second_costs_least() -> None:
    curve = energy_curve(EnergySettings())
    best = AIRSPEEDS[int(np.argmin(curve.drain_per_s))]
    assert 9.0 <= best <= 11.0
    falls = np.diff(curve.drain_per_s)
    assert (falls[AIRSPEEDS[1:] <= best - 0.2] < 0).all()
    assert (falls[AIRSPEEDS[:-1] >= best + 0.2] > 0).all()


def test_a_climb_costs_the_potential_energy_over_its_efficiency() -> None:
    curve = energy_curve(EnergySettings(climb_efficiency=0.5))
    assert curve.drain_per_m_climbed == pytest.approx(1.38 * 9.81 / 0.5 / (81.3 * 3600))


def test_an_unknown_model_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(PaveTwinError, match=r"energy\.model: no energy model 'rotors'.*did you mean 'rotor'"):
        energy_curve(EnergySettings(model="rotors"))
    with pytest.raises(ValueError, match="registered already"):
        energy_model("linear")(lambda settings: energy_curve(settings))


# In flight.


def test_a_climb_in_flight_costs_hovering_and_the_climb_and_sinking_hovering_alone() -> None:
    track = result("empty_street", "baseline").track
    curve = energy_curve(EnergySettings())
    climbing = np.flatnonzero(track["mode"] == MODES.index(Mode.CLIMB))
    begin, end = climbing[0], climbing[-1]
    seconds, metres = track["t_s"][end] - track["t_s"][begin], np.ptp(track["altitude_m"][climbing])
    fell = track["battery"][begin] - track["battery"][end]
    assert metres == pytest.approx(3.0 * seconds)
    assert fell == pytest.approx(seconds * curve.drain_per_s[0] + metres * curve.drain_per_m_climbed)
    landing = np.flatnonzero(track["mode"] == MODES.index(Mode.LAND))
    fell = track["battery"][landing[0]] - track["battery"][landing[-1]]
    assert fell == pytest.approx((track["t_s"][landing[-1]] - track["t_s"][landing[0]]) * curve.drain_per_s[0])


@pytest.mark.parametrize(
    ("wind_from_deg", "airspeed_mps"),
    [(270.0, 2.0), (90.0, 8.0), (0.0, sqrt(34)), (180.0, sqrt(34))],  # flying east at 5 m/s in a wind of 3 m/s
)
def test_wind_counts_as_airspeed(wind_from_deg: float, airspeed_mps: float) -> None:
    scene = Scene(straight((30, 0)), altitude_m=10.0)
    track = scene.fly("baseline", "conditions.wind_mps=3", f"conditions.wind_from_deg={wind_from_deg}").track
    curve = energy_curve(EnergySettings())
    cruising = (track["mode"] == MODES.index(Mode.INSPECT)) & (track["speed_mps"] > 4.999)
    both = cruising[1:] & cruising[:-1]
    rate = -np.diff(track["battery"])[both] / np.diff(track["t_s"])[both]
    expected = np.interp(airspeed_mps, AIRSPEEDS, curve.drain_per_s[: len(AIRSPEEDS)])
    assert both.sum() > 10
    assert rate[1:-1] == pytest.approx(expected, rel=1e-3)
