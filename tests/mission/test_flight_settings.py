"""Settings of a flight in the kernel: values, units, the window, and the interval between captures."""

from typing import Any

import numpy as np
import pytest

from pavetwin._core import MODES, Battery, FlightSettings, Limits, NadirCamera, Viewpoint
from pavetwin.cli.flight_report import pace_line
from pavetwin.config import load_settings
from pavetwin.config.mission import MissionSettings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import capture_interval_s, flight_settings, inspect_speed_mps, window_m
from pavetwin.mission.track import MODE_NUMBER
from pavetwin.twin import Mode
from scenes.tiny import Scene, straight

LIMITS: dict[str, Any] = {
    "speed_mps": 5.0,
    "acceleration_mps2": 8.0,
    "yaw_rate_rad_s": 0.75,
    "airspeed_mps": 15.0,
    "wind_mps": (3.0, -1.5),
}
CAMERA: dict[str, Any] = {"image_px": (1270, 950), "vertical_fov_rad": 1.0, "window_rows": 0.5, "window_columns": 1.0}
BATTERY: dict[str, Any] = {
    "drain_per_s": np.array([0.001, 0.002]),
    "lift_per_s": np.array([0.004, 0.003]),
    "drain_step_mps": 5.0,
    "drain_per_m_climbed": 0.004,
    "wind_mps": (1.0, -2.0),
    "reserve": 0.25,
}
VIEWPOINT: dict[str, Any] = {"position": (1.0, 2.0), "altitude_m": 10.0, "yaw_rad": 0.5}
SETTINGS: dict[str, Any] = {
    "altitude_m": 10.0,
    "time_step_s": 0.05,
    "radius_m": 0.5,
    "clearance_m": 1.0,
    "inspect": Limits(**LIMITS),
    "transit": Limits(**LIMITS | {"speed_mps": 10.0}),
    "stopping_distance_m": 1.0,
    "climb_speed_mps": 3.0,
    "camera": NadirCamera(**CAMERA),
    "look_steps": 6,
    "capture_steps": 12,
    "threshold": 0.7,
    "min_visible_fraction": 0.35,
    "battery": Battery(**BATTERY),
    "every_capture": True,
}
VALUES: list[tuple[type, dict[str, Any]]] = [
    (Limits, LIMITS),
    (NadirCamera, CAMERA),
    (Battery, BATTERY),
    (Viewpoint, VIEWPOINT),
    (FlightSettings, SETTINGS),
]


@pytest.mark.parametrize(("kind", "given"), VALUES)
def test_a_value_keeps_what_it_is_made_of_and_cannot_change(kind: type, given: dict[str, Any]) -> None:
    value = kind(**given)
    for name, expected in given.items():
        np.testing.assert_array_equal(getattr(value, name), expected)
        with pytest.raises(AttributeError):
            setattr(value, name, expected)


@pytest.mark.parametrize(("kind", "given"), VALUES)
def test_values_are_equal_when_all_their_parts_are(kind: type, given: dict[str, Any]) -> None:
    assert kind(**given) == kind(**given)
    others = {
        "image_px": (100, 950),
        "position": (1.0, 3.0),
        "wind_mps": (0.0, 0.0),
        "drain_per_s": np.array([0.001, 0.003]),
        "lift_per_s": np.array([0.004, 0.002]),
        "inspect": Limits(**LIMITS | {"speed_mps": 1.0}),
        "transit": Limits(**LIMITS),
        "camera": NadirCamera(**CAMERA | {"window_rows": 0.75}),
        "battery": Battery(**BATTERY | {"reserve": 0.5}),
        "every_capture": False,
    }
    for name, part in given.items():
        other = others.get(name, part / 2 if isinstance(part, float) else part)
        other = part + 1 if isinstance(part, int) and name not in others else other
        assert kind(**given | {name: other}) != kind(**given), name


@pytest.mark.parametrize(("kind", "given"), [pair for pair in VALUES if pair[0] not in {Battery, FlightSettings}])
def test_a_value_is_shown_as_it_is_written(kind: type, given: dict[str, Any]) -> None:
    assert eval(repr(kind(**given)), {kind.__name__: kind}) == kind(**given)


@pytest.mark.parametrize(
    ("kind", "given", "wrong", "message"),
    [
        (Limits, LIMITS, {"speed_mps": 0.0}, "speed_mps is 0"),
        (Limits, LIMITS, {"yaw_rate_rad_s": np.nan}, "yaw_rate_rad_s is NaN"),
        (Limits, LIMITS, {"airspeed_mps": 3.0}, "airspeed_mps is 3 in a wind of 3.35"),
        (Battery, BATTERY, {"lift_per_s": np.array([0.004])}, "lift_per_s"),
        (NadirCamera, CAMERA, {"image_px": (0, 950)}, "at least one row and one column"),
        (NadirCamera, CAMERA, {"vertical_fov_rad": 3.2}, "between 0 and 180 degrees"),
        (NadirCamera, CAMERA, {"window_across_per_altitude": 0.6}, "exactly one of"),
        (NadirCamera, CAMERA, {"window_columns": None}, "exactly one of"),
        (Battery, BATTERY, {"drain_per_s": np.empty(0)}, "number of drain_per_s entries must be positive"),
        (Battery, BATTERY, {"drain_step_mps": 0.0}, "drain_step_mps must be positive, not 0"),
        (Battery, BATTERY, {"reserve": 1.5}, "reserve must be a share between 0 and 1, not 1.5"),
        (Viewpoint, VIEWPOINT, {"altitude_m": 0.0}, "an altitude above 0, not 0 m"),
        (FlightSettings, SETTINGS, {"altitude_m": -1.0}, "altitude_m must be positive, not -1"),
        (FlightSettings, SETTINGS, {"look_steps": 0}, "look_steps must be positive, not 0"),
        (FlightSettings, SETTINGS, {"threshold": 1.1}, "threshold must be a share between 0 and 1, not 1.1"),
        (FlightSettings, SETTINGS, {"clearance_m": -1.0}, "clearance_m must be zero or more, not -1"),
    ],
)
def test_a_wrong_number_is_refused_by_its_name(
    kind: type, given: dict[str, Any], wrong: dict[str, Any], message: str
) -> None:
    with pytest.raises(PaveTwinError, match=message):
        kind(**given | wrong)


def test_the_kernel_and_the_twin_have_the_same_modes() -> None:
    assert {Mode(name) for name in MODES} == set(Mode)
    assert len(MODES) == len(Mode)


def test_settings_reach_the_kernel_in_its_units() -> None:
    settings = Scene(straight()).settings(
        "uav.yaw_rate_deg_s=90", "visibility.interval_s=0.2", "camera.capture_interval_s=1.0", "energy.reserve=0.3"
    )
    ours = flight_settings(settings, every_capture=True)
    assert ours.inspect.yaw_rate_rad_s == pytest.approx(np.pi / 2)
    assert (ours.inspect.speed_mps, ours.transit.speed_mps) == (5.0, 10.0)
    assert (ours.look_steps, ours.capture_steps) == (4, 20)
    assert ours.battery.reserve == 0.3
    assert ours.every_capture
    assert not flight_settings(settings).every_capture


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


def test_an_interval_between_two_time_steps_is_rounded_up() -> None:
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
    inspecting = slow.track["mode"] == MODE_NUMBER[Mode.INSPECT]
    assert slow.track["speed_mps"][inspecting].max() == pytest.approx(1.5)
    assert slow.rows[0].surface_coverage > 0.95
    assert hasty.rows[0].surface_coverage < 0.6
    assert slow.duration_s > 1.5 * hasty.duration_s


def test_the_paper_has_its_own_speed_and_interval() -> None:
    settings = settings_of("altitude_m=6", preset="paper")
    assert (inspect_speed_mps(settings), capture_interval_s(settings)) == (5.0, 0.6)


def test_the_pace_line_names_the_cost_of_the_camera() -> None:
    assert pace_line(settings_of()) == ""
    slow = pace_line(settings_of("aircraft=phantom4pro"))
    assert slow.startswith("Inspection speed 2.5 m/s: the camera takes an image every 2 s")
    gaps = pace_line(settings_of("aircraft=phantom4pro", "uav.inspect_speed_mps=5"))
    assert gaps == "Captures every 2 s at 5 m/s leave gaps of 5.0 m between their windows of 5.0 m."
