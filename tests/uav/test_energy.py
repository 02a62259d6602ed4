"""The energy models against their formulas, their source's numbers and their laws."""

from math import radians, sqrt, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin._core import Battery
from pavetwin.config import load_settings
from pavetwin.config.mission import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import flight_settings
from pavetwin.mission.track import MODES
from pavetwin.twin import Mode
from pavetwin.uav import AIRCRAFT, energy_curve, energy_model, find_aircraft
from pavetwin.uav.aircraft import AIR_KG_M3, AircraftProfile
from pavetwin.uav.energy import CAPACITY_AT_C, CURVE_STEP_MPS, airspeeds, rotor_power, temperature_share, usable_wh
from scenes.tiny import Scene, result, straight

AIRSPEEDS = airspeeds()


def made(**changes: float | None) -> AircraftProfile:
    return find_aircraft("phantom4pro").model_copy(update=changes)


def test_the_linear_model_empties_the_battery_in_30_minutes_whatever_the_uav_does() -> None:
    curve = energy_curve(load_settings("paper"))
    assert (curve.drain_per_s == 1 / 1800).all()
    assert curve.drain_per_m_climbed == 0.0
    assert not curve.lift_per_s.any()
    assert (energy_curve(load_settings("paper", ["energy.endurance_s=600"])).drain_per_s == 1 / 600).all()


@pytest.mark.parametrize(("airspeed_mps", "power_w"), [(0.0, 168.49), (10.0, 126.0), (20.0, 180.0), (30.0, 362.0)])
def test_with_its_sources_airframe_the_curve_has_its_sources_shape(airspeed_mps: float, power_w: float) -> None:
    """Zeng, Xu, Zhang 2019, table I and fig. 2: 20 N on a disc of 0.503 m², no tilt known; lowest about 126 W."""
    airframe = made(
        mass_kg=20 / 9.81, rotors=4, rotor_diameter_m=sqrt(0.503 / np.pi), tilt_deg=None, top_speed_mps=30.0
    )
    power = rotor_power(airframe).total_w
    watts = power * 126.0 / power.min()
    assert watts[round(airspeed_mps / CURVE_STEP_MPS)] == pytest.approx(power_w, rel=0.04)


@pytest.mark.parametrize("airspeed_mps", [0.0, 3.3, 10.2, 17.0])
def test_the_rotor_curve_is_its_formula(airspeed_mps: float) -> None:
    """Up to the scale of the maker's flight time."""
    profile, v = made(), airspeed_mps
    weight_n, disc_m2 = 1.388 * 9.81, 4 * np.pi / 4 * 0.239**2
    v0 = sqrt(weight_n / (2 * AIR_KG_M3 * disc_m2))
    induced_w = 1.1 * weight_n * v0
    drag_m2 = 2 * weight_n * tan(radians(42)) / (AIR_KG_M3 * 20**2)

    def formula(v: float) -> float:
        blade = 79.86 / 88.63 * induced_w * (1 + 3 * v**2 / 120**2)
        induced = induced_w * (sqrt(1 + v**4 / (4 * v0**4)) - v**2 / (2 * v0**2)) ** 0.5
        return float(blade + induced + AIR_KG_M3 * drag_m2 * v**3 / 2)

    lowest = min(formula(float(each)) for each in AIRSPEEDS[AIRSPEEDS <= 20])
    expected = formula(v) / lowest * 89.2 * 60 / 30
    assert rotor_power(profile).total_w[round(v / CURVE_STEP_MPS)] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", AIRCRAFT.names())
def test_power_falls_to_the_best_airspeed_and_rises_beyond(name: str) -> None:
    power = rotor_power(find_aircraft(name))
    best = AIRSPEEDS[int(np.argmin(power.total_w))]
    assert 5.0 <= best <= 12.0
    falls = np.diff(power.total_w)
    assert (falls[AIRSPEEDS[1:] <= best - 0.2] < 0).all()
    assert (falls[AIRSPEEDS[:-1] >= best + 0.2] > 0).all()
    assert (np.diff(power.lift_w) < 0).all()
    assert (np.diff(power.other_w) > 0).all()


def test_a_climb_costs_the_potential_energy_over_its_efficiency() -> None:
    curve = energy_curve(load_settings("default", ["energy.climb_efficiency=0.5", "energy.payload_kg=0.1"]))
    assert curve.drain_per_m_climbed == pytest.approx(1.015 * 9.81 / 0.5 / (77 * 0.8 * 3600))


def test_an_unknown_model_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(PaveTwinError, match=r"energy\.model: no energy model 'rotors'.*did you mean 'rotor'"):
        energy_curve(load_settings("default", ["energy.model=rotors"]))
    with pytest.raises(ValueError, match="registered already"):
        energy_model("linear")(lambda settings: energy_curve(settings))


# What a battery gives.


def test_drain_is_a_share_of_what_is_usable() -> None:
    settings = load_settings("default", ["energy.usable=0.7", "energy.health=0.9", "conditions.temperature_c=10"])
    profile = find_aircraft("mavic3e")
    assert usable_wh(settings, profile) == pytest.approx(77 * 0.7 * 0.9 * 0.9)
    hover_w = rotor_power(profile).total_w[0]
    assert energy_curve(settings).drain_per_s[0] == pytest.approx(hover_w / (77 * 0.7 * 0.9 * 0.9 * 3600))


def test_two_batteries_hold_twice_as_much() -> None:
    assert usable_wh(load_settings(), find_aircraft("matrice350")) == pytest.approx(2 * 263.2 * 0.8)


def test_the_reserve_is_a_share_of_the_usable_energy_and_is_counted_once() -> None:
    """Nothing of the reserve is taken from the capacity, and nothing of the unusable part from the reserve."""
    with_reserve = energy_curve(load_settings("default", ["energy.reserve=0.4"])).drain_per_s
    assert (with_reserve == energy_curve(load_settings("default", ["energy.reserve=0"])).drain_per_s).all()
    assert flight_settings(load_settings("default", ["energy.usable=0.5"])).battery.reserve == 0.15


@given(st.floats(-30, 50), st.floats(0, 30))
def test_warmth_never_takes_energy_away(temperature_c: float, warmer_c: float) -> None:
    assert temperature_share(temperature_c + warmer_c) >= temperature_share(temperature_c) > 0


def test_cold_takes_energy_away() -> None:
    shares = [temperature_share(temperature_c) for temperature_c, _ in CAPACITY_AT_C]
    assert (np.diff(shares) > 0).all()
    assert temperature_share(20.0) == temperature_share(35.0) == 1.0
    assert temperature_share(0.0) == pytest.approx(0.75)


@given(st.floats(0.3, 1), st.floats(0.3, 1))
def test_an_aged_battery_never_lasts_longer(health: float, other: float) -> None:
    low, high = sorted((health, other))
    hover = [energy_curve(load_settings(energy={"health": each})).drain_per_s[0] for each in (low, high)]
    assert hover[0] >= hover[1]
    assert hover[0] * low == pytest.approx(hover[1] * high)


# Wind: laws of what the kernel drains.


def in_wind(aircraft: str, wind_mps: float, wind_from_deg: float = 270.0) -> Battery:
    conditions = {"wind_mps": wind_mps, "wind_from_deg": wind_from_deg}
    return flight_settings(load_settings(aircraft=aircraft, conditions=conditions)).battery


KNOWN = st.sampled_from(["phantom4", "phantom4pro", "mavic2pro", "mavic3e", "matrice4e", "matrice350"])
WINDS = st.floats(0.1, 10)
GROUND_SPEEDS = st.floats(0, 12)
ANGLES = st.floats(0, 359)


@given(KNOWN, WINDS, WINDS)
def test_wind_never_saves_energy_while_hovering(aircraft: str, wind_mps: float, more_mps: float) -> None:
    low, high = sorted((wind_mps, more_mps))
    calm = in_wind(aircraft, 0.0).drained((0.0, 0.0))
    hovering = [in_wind(aircraft, each).drained((0.0, 0.0)) for each in (low, high)]
    assert calm < hovering[0] <= hovering[1]


@given(KNOWN, WINDS, ANGLES, GROUND_SPEEDS)
def test_out_and_back_in_wind_is_never_cheaper_than_in_calm(
    aircraft: str, wind_mps: float, wind_from_deg: float, ground_mps: float
) -> None:
    windy, calm = in_wind(aircraft, wind_mps, wind_from_deg), in_wind(aircraft, 0.0)
    out, back = windy.drained((ground_mps, 0.0)), windy.drained((-ground_mps, 0.0))
    assert (out + back) / 2 >= calm.drained((ground_mps, 0.0)) * (1 - 1e-9)


# In flight.


def settings_of(track_of: MissionSettings) -> tuple[np.ndarray, float]:
    curve = energy_curve(track_of)
    return curve.drain_per_s, curve.drain_per_m_climbed


def test_a_climb_in_flight_costs_hovering_and_the_climb_and_sinking_hovering_alone() -> None:
    flown = result("empty_street", "baseline")
    track, (drain_per_s, per_m) = flown.track, settings_of(flown.settings)
    climbing = np.flatnonzero(track["mode"] == MODES.index(Mode.CLIMB))
    begin, end = climbing[0], climbing[-1]
    seconds, metres = track["t_s"][end] - track["t_s"][begin], np.ptp(track["altitude_m"][climbing])
    fell = track["battery"][begin] - track["battery"][end]
    assert metres == pytest.approx(3.0 * seconds)
    assert fell == pytest.approx(seconds * drain_per_s[0] + metres * per_m)
    landing = np.flatnonzero(track["mode"] == MODES.index(Mode.LAND))
    fell = track["battery"][landing[0]] - track["battery"][landing[-1]]
    assert fell == pytest.approx((track["t_s"][landing[-1]] - track["t_s"][landing[0]]) * drain_per_s[0])


@pytest.mark.parametrize(
    ("wind_from_deg", "airspeed_mps"),
    [(270.0, 2.0), (90.0, 8.0), (0.0, sqrt(34)), (180.0, sqrt(34))],  # flying east at 5 m/s in a wind of 3 m/s
)
def test_wind_counts_as_airspeed_for_drag_and_never_for_lift(wind_from_deg: float, airspeed_mps: float) -> None:
    scene = Scene(straight((30, 0)), altitude_m=10.0)
    flown = scene.fly("baseline", "conditions.wind_mps=3", f"conditions.wind_from_deg={wind_from_deg}")
    track, curve = flown.track, energy_curve(flown.settings)
    cruising = (track["mode"] == MODES.index(Mode.INSPECT)) & (track["speed_mps"] > 4.999)
    both = cruising[1:] & cruising[:-1]
    rate = -np.diff(track["battery"])[both] / np.diff(track["t_s"])[both]
    rest = np.interp(airspeed_mps, AIRSPEEDS, curve.drain_per_s - curve.lift_per_s)
    lift = np.interp(min(airspeed_mps, 5.0), AIRSPEEDS, curve.lift_per_s)
    assert both.sum() > 10
    assert rate[1:-1] == pytest.approx(rest + lift, rel=1e-3)
