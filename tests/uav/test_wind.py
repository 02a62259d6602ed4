"""Wind: what is refused, how far the airframe tilts, what gusts do to frames, and how fast the UAV gets on."""

from dataclasses import replace
from math import atan, degrees, hypot, pi

import numpy as np
import pytest

from pavetwin._core import Captured
from pavetwin.arrays import Float64Array
from pavetwin.config import MissionSettings, load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import flight_settings
from pavetwin.mission.mission import Mission
from pavetwin.mission.planning import check_names
from pavetwin.mission.track import MODES
from pavetwin.sensing import Frame
from pavetwin.twin import Mode
from pavetwin.uav import find_aircraft
from pavetwin.uav.aircraft import Gimbal
from pavetwin.uav.wind import GIMBAL_LEAK, GUST_HZ, gust_course, shake_mps, tilt_deg
from scenes.tiny import Scene, straight

# Rated wind.


@pytest.mark.parametrize(
    ("wind_mps", "gust_factor", "words"),
    [
        (10.1, 1.0, "a wind of 10.1 m/s is above the 10 m/s that the DJI Phantom 4 Pro is rated for"),
        (8.0, 1.5, "a wind of 8 m/s with gusts of 12 m/s is above the 10 m/s that the DJI Phantom 4 Pro is rated for"),
    ],
)
def test_wind_above_the_rated_limit_is_refused_in_one_line(wind_mps: float, gust_factor: float, words: str) -> None:
    conditions = {"wind_mps": wind_mps, "gust_factor": gust_factor}
    settings = load_settings(aircraft="phantom4pro", conditions=conditions)
    for refusing in (lambda: check_names(settings, ["hover"], 0), lambda: flight_settings(settings)):
        with pytest.raises(PaveTwinError) as caught:
            refusing()
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wind_mps", "words"),
    [
        (11.0, "included; or fly another `aircraft`: mavic3e (12 m/s), "),
        (13.0, "included; no aircraft known here is rated for more than 12 m/s. Unless"),
    ],
)
def test_a_refused_wind_names_aircraft_that_fly_in_it(wind_mps: float, words: str) -> None:
    settings = load_settings(aircraft="phantom4", conditions={"wind_mps": wind_mps})
    with pytest.raises(PaveTwinError) as caught:
        check_names(settings, ["hover"], 0)
    assert f"Wait for 10 m/s or less, gusts {words}" in str(caught.value)


def test_wind_up_to_the_limit_is_flown_and_the_paper_knows_no_limit() -> None:
    flight_settings(load_settings(aircraft="phantom4pro", conditions={"wind_mps": 10.0}))
    flight_settings(load_settings("paper", conditions={"wind_mps": 30.0}))


# Tilt.


def test_the_airframe_has_its_makers_tilt_at_top_speed() -> None:
    for name, tilt in (("phantom4", 42), ("mavic3e", 35), ("matrice350", 30)):
        profile = find_aircraft(name)
        assert tilt_deg(profile, profile.top_speed_mps, -profile.payload_kg) == pytest.approx(tilt)
        assert tilt_deg(profile, 0.0) == 0.0


def test_tilt_balances_drag_and_weight() -> None:
    """tan θ grows with the square of the airspeed, and falls with the mass."""
    profile = find_aircraft("mavic3e")
    at_top = np.tan(np.radians(35))
    assert tilt_deg(profile, 10.5) == pytest.approx(degrees(atan(at_top / 4)))
    assert tilt_deg(profile, 21.0, payload_kg=0.915) == pytest.approx(degrees(atan(at_top / 2)))


def test_the_phantoms_figures_for_sport_and_for_automatic_flight_agree() -> None:
    """Its maker names 42° at 20 m/s and 25° at 50 km/h: one drag explains both."""
    assert tilt_deg(find_aircraft("phantom4pro"), 50 / 3.6) == pytest.approx(25, rel=0.1)


# Gusts.


def shaken(gust_factor: float, axes: int = 3, wind_mps: float = 5.0, altitude_m: float = 10.0) -> float:
    """Largest motion on the ground that gusts add while hovering."""
    profile = find_aircraft("mavic3e")
    if axes == 0:
        profile = profile.model_copy(update={"gimbal": Gimbal(axes=0)})
    conditions = {"wind_mps": wind_mps, "gust_factor": gust_factor}
    settings = load_settings(altitude_m=altitude_m, conditions=conditions)
    return max(hypot(*shake_mps(profile, settings, (0.0, 0.0), t)) for t in np.linspace(0, 1, 41))


def test_a_steady_wind_shakes_nothing_and_gusts_do() -> None:
    assert shaken(1.0) == 0.0
    assert 0 < shaken(1.2) < shaken(1.5) < shaken(2.0)


def test_gusts_shake_by_the_model() -> None:
    """At 5 m/s with gusts to 7.5: the push is g Δtan θ / 2πf, the turn altitude × 2πf × a share of the swing."""
    tilts = [np.radians(tilt_deg(find_aircraft("mavic3e"), each)) for each in (2.5, 5.0, 7.5)]
    pushed = 9.81 * (np.tan(tilts[2]) - np.tan(tilts[1])) / (2 * pi * GUST_HZ)
    turned = 10.0 * 2 * pi * GUST_HZ * GIMBAL_LEAK * (tilts[2] - tilts[0]) / 2
    settings = load_settings(altitude_m=10.0, conditions={"wind_mps": 5.0, "gust_factor": 1.5})
    assert seen_rms_mps(settings, np.arange(0, 1000, 0.05)) == pytest.approx((pushed + turned) / 2**0.5, rel=0.01)


def seen_rms_mps(settings: MissionSettings, times_s: Float64Array) -> float:
    """RMS of the motion on the ground that gusts add at some moments of hovering."""
    speeds = [hypot(*shake_mps(find_aircraft("mavic3e"), settings, (0.0, 0.0), time_s)) for time_s in times_s.tolist()]
    return float(np.sqrt(np.mean(np.square(speeds))))


def test_no_interval_between_captures_repeats_with_the_gusts() -> None:
    for interval_s in np.arange(0.3, 5.0, 0.02).tolist():
        seen = np.sqrt(np.mean([gust_course(interval_s * k) ** 2 for k in range(200)]))
        assert seen == pytest.approx(0.5**0.5, rel=0.2), f"captures every {interval_s:.2f} s"


def test_a_camera_without_gimbal_is_shaken_much_more() -> None:
    assert shaken(1.5, axes=0) > 5 * shaken(1.5)


def test_a_tilt_that_the_gimbal_cannot_hold_shakes_the_camera_like_a_fixed_one() -> None:
    profile = find_aircraft("mavic3e")
    weak = profile.model_copy(update={"gimbal": Gimbal(axes=3, holds_deg=1.0)})
    settings = load_settings(conditions={"wind_mps": 8.0, "gust_factor": 1.5})
    strong, held_up_to_1_deg = (hypot(*shake_mps(each, settings, (0.0, 0.0), 0.0)) for each in (profile, weak))
    assert held_up_to_1_deg > 3 * strong


def test_gusts_shake_along_the_wind() -> None:
    settings = load_settings(conditions={"wind_mps": 6.0, "wind_from_deg": 0.0, "gust_factor": 1.5})
    east, north = shake_mps(find_aircraft("mavic3e"), settings, (3.0, 0.0), 0.0)
    assert east == pytest.approx(0.0, abs=1e-12)
    assert abs(north) > 0.01


def frames(*overrides: str) -> list[Frame]:
    """Those of a mission along a street, as sensors get them."""
    scene = Scene(straight(*[(5.0 * k, 0) for k in range(1, 12)]), altitude_m=10.0)
    settings = scene.settings(*overrides)
    mission = Mission(scene.environment(settings), scene.traffic(), settings, [0])
    return [mission.frame(event) for event in mission if isinstance(event, Captured)]


def test_gusts_reach_the_frames_of_a_mission_and_their_blur() -> None:
    steady, gusty = (frames("conditions.wind_mps=6", f"conditions.gust_factor={factor}") for factor in (1, 1.6))
    assert [frame.position for frame in steady] == [frame.position for frame in gusty]
    cruising = [number for number, frame in enumerate(steady) if hypot(*frame.velocity_mps) > 4.99]
    added = [hypot(*np.subtract(gusty[k].velocity_mps, steady[k].velocity_mps)) for k in cruising]
    assert min(added) >= 0.0
    assert max(added) > 0.05
    frame = steady[cruising[0]]
    pixel_m = frame.camera.footprint_m(10.0)[1] / frame.camera.image_px[1]
    assert replace(frame, exposure_s=1 / 500).blur_px == pytest.approx(5.0 / 500 / pixel_m, rel=1e-3)


# Ground speed.


def fastest(*overrides: str) -> float:
    """Ground speed on the way to a street 100 m east of the base."""
    scene = Scene(straight((150, 0), length_m=200.0), altitude_m=10.0)
    track = scene.fly("baseline", "uav.inspect_speed_mps=15", "aircraft=phantom4pro", *overrides).track
    return float(track["speed_mps"][track["mode"] == MODES.index(Mode.INSPECT)].max())


@pytest.mark.parametrize(("wind_from_deg", "expected_mps"), [(90.0, 12.0), (270.0, 15.0), (0.0, 15.0)])
def test_a_head_wind_leaves_less_of_the_top_speed(wind_from_deg: float, expected_mps: float) -> None:
    """An airframe of 20 m/s at most, asked to inspect at 15 m/s eastwards, in 8 m/s."""
    wind = ("conditions.wind_mps=8", f"conditions.wind_from_deg={wind_from_deg}")
    assert fastest(*wind) == pytest.approx(expected_mps, abs=0.01)


def test_across_the_wind_the_airspeed_is_what_counts() -> None:
    limits = flight_settings(
        load_settings(aircraft="phantom4pro", uav={"transit_speed_mps": 30.0}, conditions={"wind_mps": 8.0})
    ).transit
    assert limits.speed_towards(pi / 2) == pytest.approx((20**2 - 8**2) ** 0.5)
    assert limits.speed_towards(0.0) == pytest.approx(28.0)
    assert limits.speed_towards(pi) == pytest.approx(12.0)
