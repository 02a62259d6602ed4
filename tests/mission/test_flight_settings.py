"""The kernel's values: checked when they are made, equal by value, shown as they are written."""

import runpy
from typing import Any

import numpy as np
import pytest

from pavetwin import _core
from pavetwin._core import MODES, Battery, FlightSettings, Limits, NadirCamera, Viewpoint
from pavetwin.errors import PaveTwinError
from pavetwin.mission import track
from pavetwin.mission.environment import flight_settings, window_m
from pavetwin.twin import Mode
from pavetwin.uav import camera_of
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


def test_settings_show_every_part() -> None:
    shown = repr(FlightSettings(**SETTINGS))
    assert all(f"{name}=" in shown for name in SETTINGS)
    assert all(repr(SETTINGS[name]) in shown for name in ("inspect", "transit", "camera", "battery", "every_capture"))
    assert "drain_per_s=<2 values>" in shown


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


def test_the_numbers_of_modes_are_the_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a kernel that has them in another order than `Mode`."""
    monkeypatch.setattr(_core, "MODES", MODES[::-1])
    numbers = runpy.run_path(track.__file__)
    assert [str(mode) for mode in numbers["MODES"]] == list(MODES[::-1])
    assert {str(mode): number for mode, number in numbers["MODE_NUMBER"].items()} == {
        name: number for number, name in enumerate(MODES[::-1])
    }


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


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_the_window_is_the_footprints_share(preset: str) -> None:
    settings = Scene(straight(), altitude_m=15.0).settings(preset=preset)
    across, along = camera_of(settings).footprint_m(15.0)
    rows = settings.camera.window_rows
    expected = (0.6 * 15.0, along * rows) if preset == "paper" else (across, along * rows)
    assert window_m(settings) == pytest.approx(expected)
