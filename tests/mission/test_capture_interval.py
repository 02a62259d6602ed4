"""Cameras take a picture every so often: captures come no faster, and inspection is as slow as that takes."""

import numpy as np
import pytest

from pavetwin.cli.report import pace_line
from pavetwin.config import load_settings
from pavetwin.config.mission import MissionSettings
from pavetwin.mission.environment import capture_interval_s, flight_settings, inspect_speed_mps, window_m
from pavetwin.mission.track import MODES
from pavetwin.twin import Mode
from scenes.tiny import Scene, straight

STREET = straight(length_m=60.0)


def settings_of(*overrides: str, preset: str = "default") -> MissionSettings:
    return load_settings(preset, overrides)


@pytest.mark.parametrize(
    ("overrides", "interval_s"),
    [
        (("aircraft=mavic3e",), 0.7),
        (("aircraft=phantom4pro",), 2.0),
        (("aircraft=mavic3e", "camera.capture_interval_s=3"), 3.0),
        (("aircraft=mavic3e", "camera.model=paper"), 0.6),
        (("time_step_s=0.02", "visibility.interval_s=0.3", "camera.capture_interval_s=0.6"), 0.7),
    ],
)
def test_captures_come_no_faster_than_the_camera_can(overrides: tuple[str, ...], interval_s: float) -> None:
    settings = settings_of(*overrides)
    assert capture_interval_s(settings) == pytest.approx(interval_s)
    assert flight_settings(settings).capture_steps == round(interval_s / settings.time_step_s)


def test_an_interval_between_two_time_steps_is_the_longer() -> None:
    assert capture_interval_s(settings_of("time_step_s=0.1")) == pytest.approx(0.7)
    assert capture_interval_s(settings_of("time_step_s=0.06")) == pytest.approx(0.72)


def test_a_flight_captures_at_the_cameras_interval() -> None:
    captures = Scene(STREET, altitude_m=10.0).fly("baseline", "camera.model=mavic3e").captures
    spacing_s = np.diff(captures["t_s"])
    assert spacing_s.min() == pytest.approx(0.7)
    assert np.median(spacing_s) == pytest.approx(0.7)


@pytest.mark.parametrize("altitude_m", [6.0, 10.0, 40.0])
@pytest.mark.parametrize("aircraft", ["phantom4", "phantom4pro", "mavic3e", "matrice350"])
def test_inspection_is_slow_enough_for_the_windows_of_captures_to_touch(aircraft: str, altitude_m: float) -> None:
    settings = settings_of(f"aircraft={aircraft}", f"altitude_m={altitude_m}")
    speed_mps, along_m = inspect_speed_mps(settings), window_m(settings)[1]
    assert speed_mps * capture_interval_s(settings) <= along_m + 1e-9
    assert speed_mps == 5.0 or speed_mps * capture_interval_s(settings) == pytest.approx(along_m)
    assert flight_settings(settings).inspect.speed_mps == speed_mps


def test_a_slow_camera_flies_slower_and_sees_all() -> None:
    scene = Scene(STREET, altitude_m=6.0)
    slow, hasty = (
        scene.fly("baseline", "camera.model=phantom4pro", *more) for more in ([], ["uav.inspect_speed_mps=5"])
    )
    inspecting = slow.track["mode"] == MODES.index(Mode.INSPECT)
    assert slow.track["speed_mps"][inspecting].max() == pytest.approx(1.5)
    assert slow.rows[0].surface_coverage > 0.95
    assert hasty.rows[0].surface_coverage < 0.6
    assert slow.duration_s > 1.5 * hasty.duration_s


def test_the_paper_has_its_own_speed_and_interval() -> None:
    settings = settings_of("altitude_m=6", preset="paper")
    assert (inspect_speed_mps(settings), capture_interval_s(settings)) == (5.0, 0.6)


def test_a_user_is_told_what_the_camera_costs() -> None:
    assert pace_line(settings_of()) == ""
    slow = pace_line(settings_of("aircraft=phantom4pro"))
    assert slow.startswith("Inspects at 2.5 m/s: its camera takes a picture every 2 s")
    gaps = pace_line(settings_of("aircraft=phantom4pro", "uav.inspect_speed_mps=5"))
    assert gaps == "Captures every 2 s at 5 m/s leave gaps of 5.0 m between their windows of 5.0 m."
