"""What a mission takes, before it is flown: that of the same flight over empty streets."""

from pavetwin.config import load_settings
from pavetwin.mission.estimate import estimate
from pavetwin.mission.metrics import totals
from pavetwin.uav import camera_of
from scenes import tiny


def test_over_empty_streets_the_estimate_is_what_a_mission_takes() -> None:
    flown = tiny.result("empty_street", "baseline")
    known, sums = estimate(flown.environment, flown.settings, [0]), totals(flown)
    assert (known.time_s, known.energy, known.batteries) == (sums.time_s, sums.energy, sums.batteries)
    assert known.images == len(flown.captures["t_s"])
    assert known.surface_coverage == sums.surface_coverage
    assert known.length_m == flown.rows[0].length_m
    assert known.pixel_mm == 1000 * camera_of(flown.settings).ground_resolution_m(flown.settings.altitude_m)


def test_waits_and_hidden_surface_are_left_out() -> None:
    flown = tiny.result("queue_at_light", "hover")
    known, sums = estimate(flown.environment, flown.settings, [0]), totals(flown)
    assert sums.wait_s > 0
    assert known.time_s < sums.time_s
    assert known.surface_coverage >= (sums.surface_coverage or 0.0)


def test_the_policys_options_and_the_sensor_do_not_matter() -> None:
    flown = tiny.result("empty_street", "baseline")
    other = load_settings(
        altitude_m=flown.settings.altitude_m,
        sensing={"sensor": "detector"},
        policy={"options": {"max_wait_s": 5.0}},
    )
    plain = load_settings(altitude_m=flown.settings.altitude_m)
    assert estimate(flown.environment, other, [0]) == estimate(flown.environment, plain, [0])
