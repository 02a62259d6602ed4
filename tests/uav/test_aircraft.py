"""Aircraft profiles: the makers' figures, a user's own, and what the settings make of them."""

from pathlib import Path

import numpy as np
import pytest

from pavetwin.config import load_settings
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import flight_settings, window_m
from pavetwin.mission.spec import files_of_settings
from pavetwin.uav import AIRCRAFT, camera_of, find_aircraft, find_camera
from pavetwin.uav.aircraft import AircraftProfile
from pavetwin.uav.energy import airspeeds, rotor_power

DOCS = (Path(__file__).parents[2] / "docs/explanation/aircraft.md").read_text(encoding="utf-8")

OWN = """
survey:
  title: My survey UAV
  camera: phantom4pro
  mass_kg: 2.5
  rotors: 6
  rotor_diameter_m: 0.3
  battery_wh: 200
  flight_time_min: 30
  top_speed_mps: 15
  climb_mps: 4
  descent_mps: 3
  wind_limit_mps: 9
  gimbal: {axes: 3, tilt_deg: [-90, 30], holds_deg: 30}
  source: its data sheet
"""


def refused(name: str) -> str:
    with pytest.raises(PaveTwinError) as caught:
        find_aircraft(name)
    reported = str(caught.value)
    assert "\n" not in reported
    return reported


def minutes(profile: AircraftProfile, speed_mps: float) -> float:
    """The model's flight in still air at an airspeed, from full to empty, as the maker flew it."""
    watts = rotor_power(profile, -profile.payload_kg).total_w[round(10 * speed_mps)]
    return 60 * profile.capacity_wh / float(watts)


def longest(profile: AircraftProfile) -> float:
    """The model's longest flight up to the top speed, in minutes."""
    flown = airspeeds()[airspeeds() <= profile.top_speed_mps]
    return max(minutes(profile, float(speed)) for speed in flown)


def test_profiles_are_anchored_at_the_times_that_their_makers_state() -> None:
    """At the airspeed that the maker states, else at the best up to the top speed; the hover where one is stated."""
    for profile in AIRCRAFT.values():
        speed = profile.flight_speed_mps
        flight_min = longest(profile) if speed is None else minutes(profile, speed)
        assert flight_min == pytest.approx(profile.flight_time_min, rel=1e-3)
        assert minutes(profile, 0) < longest(profile)
        if profile.hover_time_min is not None:
            assert minutes(profile, 0) == pytest.approx(profile.hover_time_min, rel=1e-12)


def with_times(hover_min: float, speed_mps: float | None) -> AircraftProfile:
    stated = {"flight_time_min": 28.0, "flight_speed_mps": speed_mps, "hover_time_min": hover_min}
    return MATRICE_100.model_copy(update=stated)


@pytest.mark.parametrize(
    ("hover_min", "speed_mps"), [(19, None), (24, None), (27.5, None), (24, 5.0), (19, 12.0), (27.9, 1.0)]
)
def test_both_stated_times_hold(hover_min: float, speed_mps: float | None) -> None:
    profile = with_times(hover_min, speed_mps)
    flight_min = longest(profile) if speed_mps is None else minutes(profile, speed_mps)
    assert (flight_min, minutes(profile, 0)) == pytest.approx((28.0, hover_min), rel=1e-12)
    assert (rotor_power(profile).lift_w > 0).all()
    assert (rotor_power(profile).other_w > 0).all()


def test_times_that_no_rotor_explains_are_refused() -> None:
    with pytest.raises(PaveTwinError, match="omit hover_time_min"):
        rotor_power(with_times(19, 1.0))


MAKERS_AIRCRAFT = {
    "Mavic Pro": (0.734, 0.211, 18, 35, 27, 6.9, 24),
    "Mavic Pro Platinum": (0.734, 0.211, 18, 35, 30, 6.9, 27),
    "Mavic 2 Pro": (0.907, 0.221, 20, 35, 31, 6.9, 29),
    "Mavic 3": (0.895, 0.239, 21, 35, 46, None, 40),
    "Mavic 3 Enterprise": (0.915, 0.239, 21, 35, 45, None, 38),
    "Matrice 4E": (1.219, 0.274, 21, 35, 49, None, 42),
    "Autel EVO Max 4T": (1.665, 0.279, 23, 36, 42, None, 37),
    "Matrice 30": (3.77, 0.406, 23, 35, 41, None, 36),
}
"""Aircraft whose makers state a longest flight and a longest hover: kg, rotors' diameter [m], top speed [m/s], tilt at
it [°], flight [min], the airspeed of that flight [m/s] where stated, hover [min]."""


def predicted_hover_min(name: str) -> float:
    """From mass, rotors, tilt and the longest flight alone; the battery's energy cancels out."""
    mass_kg, diameter_m, top_mps, tilt, flight_min, speed_mps, _ = MAKERS_AIRCRAFT[name]
    blind = MATRICE_100.model_copy(
        update={
            "mass_kg": mass_kg,
            "rotor_diameter_m": diameter_m,
            "top_speed_mps": top_mps,
            "tilt_deg": tilt,
            "flight_time_min": flight_min,
            "flight_speed_mps": speed_mps,
            "hover_time_min": None,
        }
    )
    return minutes(blind, 0)


def test_the_hover_of_eight_aircraft_is_predicted_within_a_tenth() -> None:
    """Each maker states the hover too, and the prediction knows nothing of it. The errors are those of the docs."""
    errors = {name: predicted_hover_min(name) / row[-1] - 1 for name, row in MAKERS_AIRCRAFT.items()}
    assert max(abs(error) for error in errors.values()) < 0.1
    assert np.mean(np.abs(list(errors.values()))) < 0.03
    for name, error in errors.items():
        assert f"| {name} " in DOCS
        (row,) = (line for line in DOCS.splitlines() if line.startswith(f"| {name} |"))
        assert row.split("|")[-2].strip() == f"{100 * error:+.1f} %".replace("-", "−")


MATRICE_100 = AircraftProfile(
    title="DJI Matrice 100 with one TB48D",
    camera="paper",
    mass_kg=2.431,
    rotors=4,
    rotor_diameter_m=0.33,
    battery_wh=129.96,
    flight_time_min=31,
    top_speed_mps=22,
    tilt_deg=35,
    climb_mps=5,
    descent_mps=4,
    wind_limit_mps=10,
    gimbal={"axes": 0},  # type: ignore[arg-type]
    source="DJI",
)


@pytest.mark.parametrize(("payload_kg", "minutes"), [(0.5, 20), (1.0, 16)])
def test_a_payload_shortens_the_flight_by_the_makers_figures(payload_kg: float, minutes: float) -> None:
    """DJI's table for the Matrice 100 with a TB48D: 28 min, 20 with 500 g, 16 with 1 kg ("Hardware Introduction")."""
    bare, laden = (rotor_power(MATRICE_100, each).total_w[0] for each in (0.0, payload_kg))
    assert laden / bare == pytest.approx(28 / minutes, rel=0.1)


def test_the_aircraft_gives_the_camera_unless_one_is_named() -> None:
    assert camera_of(load_settings(aircraft="phantom4pro")) == find_camera("phantom4pro")
    assert camera_of(load_settings(aircraft="phantom4pro", camera={"model": "paper"})) == find_camera("paper")
    assert window_m(load_settings(aircraft="matrice350")) != window_m(load_settings())
    with pytest.raises(PaveTwinError, match=r"without an aircraft give a camera"):
        camera_of(load_settings(aircraft=None))


def test_without_an_aircraft_there_is_no_rotor_model() -> None:
    with pytest.raises(PaveTwinError, match=r"the model rotor needs an aircraft"):
        flight_settings(load_settings(aircraft=None, camera={"model": "paper"}))


def test_the_aircraft_limits_climb_and_speed(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(OWN.replace("descent_mps: 3", "descent_mps: 2"), encoding="utf-8")
    ours = flight_settings(load_settings(aircraft=str(tmp_path / "own.yaml")))
    assert ours.climb_speed_mps == 2.0
    assert ours.transit.airspeed_mps == 15.0
    paper = flight_settings(load_settings("paper"))
    assert (paper.climb_speed_mps, paper.transit.airspeed_mps) == (3.0, None)


@pytest.mark.parametrize("payload_kg", [0.1, 0.4, 2.0])
def test_a_payload_costs_at_every_airspeed(payload_kg: float) -> None:
    profile = find_aircraft("mavic3e")
    assert (rotor_power(profile, payload_kg).total_w > rotor_power(profile).total_w).all()
    assert np.isfinite(rotor_power(profile, payload_kg).total_w).all()


# A user's own.


def test_a_users_own_aircraft_is_found_by_its_file_and_its_camera_next_to_it(tmp_path: Path) -> None:
    (tmp_path / "cam.yaml").write_text(
        "{wide: {title: W, image_px: [900, 600], vertical_fov_deg: 50}}", encoding="utf-8"
    )
    own = tmp_path / "own.yaml"
    own.write_text(OWN.replace("camera: phantom4pro", "camera: cam.yaml:wide"), encoding="utf-8")
    settings = load_settings(aircraft=f"{own}:survey")
    assert find_aircraft(str(own)) == find_aircraft(f"{own}:survey")
    assert camera_of(settings).title == "W"
    assert {Path(file.path).name for file in files_of_settings(settings)} == {"own.yaml", "cam.yaml"}


def test_an_unknown_aircraft_is_refused_with_the_nearest_name() -> None:
    assert "did you mean 'mavic3e'?" in refused("mavic3")
    assert "matrice350" in refused("zzz")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("mass_kg: 2.5", "mass_kg: 0"), "mass_kg: it must be greater than 0"),
        (("mass_kg: 2.5", "mass: 2.5"), "unknown key 'mass' (did you mean 'mass_kg'"),
        (("flight_time_min: 30", "flight_time_min: 30\n  hover_time_min: 31"), "hovering cannot last longer"),
        (("flight_time_min: 30", "flight_time_min: 30\n  hover_time_min: 5"), "less than half of flight_time_min"),
        (("wind_limit_mps: 9", "wind_limit_mps: 15"), "wind_limit_mps must be below top_speed_mps"),
        (("flight_time_min: 30", "flight_time_min: 30\n  flight_speed_mps: 16"), "flight_speed_mps must not be above"),
        (("axes: 3", "axes: 1"), "gimbal.axes"),
        (("[-90, 30]", "[-60, 30]"), "gimbal: tilt_deg: the camera must reach straight down"),
        (("axes: 3", "axes: 0"), "gimbal: holds_deg: a camera without stabilised axes"),
        (("source: its data sheet", "sources: {weight: x}\n  source: y"), "sources: 'weight' is not a key"),
        (("camera: phantom4pro", "camera: phantom5pro"), "camera: no camera 'phantom5pro' (did you mean 'phantom4pro'"),
    ],
)
def test_a_mistake_in_an_own_aircraft_is_one_plain_line_with_its_place(
    change: tuple[str, str], complaint: str, tmp_path: Path
) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(OWN.replace(*change), encoding="utf-8")
    reported = refused(str(own))
    assert reported.startswith(f"{own}, aircraft 'survey': ")
    assert complaint in reported
